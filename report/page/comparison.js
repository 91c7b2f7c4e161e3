"use strict";

/** The page of two records laid over each other. */
rubato.comparison = (data) => {
  const { records } = data;
  const labels = records.map((record, i) => `${"AB"[i]}: ${record.provenance.record}`);
  const letter = (i) => "AB"[i];
  const line = (label) => {
    const found = data.lines.find(([name]) => name === label);
    return found ? [label, `A ${found[1] || "\u2013"}`, `B ${found[2] || "\u2013"}`] : null;
  };
  rubato.tables.head(records[0].title === records[1].title ? records[0].title : `${records[0].title} and ${records[1].title}`,
    labels.join(" \u00b7 "), ["steps", "step length", "discrete energy, relative deviation", "node energy, deviation"].map(line).filter(Boolean));

  if (records[0].kind === "orbit") rubato.comparedOrbits(records, letter);
  else rubato.comparedLattices(records, letter);

  const curves = records.map(rubato.commonCurves.unpack);
  const offLaw = records.flatMap(rubato.commonCurves.offLaw);
  const titles = { energy: "Energy", h: "Time levels", gamma: "Time levels", condition: "Time levels", iterations: "Time levels",
    error: "Errors", residual: "Local laws, step by step", total: "Totals and invariants", invariant: "Totals and invariants" };
  const logarithmic = ["energy", "condition", "residual"];
  const grids = {};
  const found = new Map(curves.flat().map((curve) => [`${curve.group} ${curve.name}`, curve]));
  found.forEach(({ group, name }) => {
    const both = curves.map((all, i) => all.filter((curve) => curve.group === group && curve.name === name)
      .map((curve) => ({ ...curve, label: `${letter(i)} ${name}`, colour: i, dash: i === 1 ? [5, 3] : undefined }))).flat();
    const section = titles[group];
    grids[section] = grids[section] || rubato.section(section);
    const isLogarithmic = logarithmic.includes(group);
    const names = { h: "Step length", gamma: "\u0393", "step condition": "Step condition", iterations: "Iterations of the step" };
    const title = group === "error" ? `Error in ${name}` : group === "energy" ? `Deviation of the ${name}` : (group === "total" ? `Total ${name}` : names[name] || name);
    rubato.commonCurves.show(grids[section], title, isLogarithmic ? both.map(rubato.commonCurves.magnitude) : both,
      { logarithmic: isLogarithmic, yLabel: ["invariant", "total"].includes(group) ? "deviation" : name, offLaw });
  });

  rubato.tables.laws(["Law or figure", labels[0], labels[1]], data.lines.map((row) => row.map((text) => text || "\u2013")));
  const difference = rubato.card(rubato.section("Problem and provenance", "problem"), "Where the problems differ", { wide: true });
  const marked = data.only_in.flatMap((lines, i) => lines.map((text) => `${letter(i)}  ${text}\n`));
  difference.body.append(rubato.element("pre", {}, marked.length > 0 ? marked.join("") : "Nowhere: both records are of the same problem."));
  rubato.tables.origin(records);
};

/** Portraits and coordinates of two orbits. */
rubato.comparedOrbits = (records, letter) => {
  const states = records.map((record, i) => ({ ...rubato.unpackStates(record.states), label: letter(i) }));
  const common = states[0].columns.filter((column) => column.group !== "exact" &&
    states[1].columns.some((other) => other.name === column.name && other.group === column.group));
  const q = common.filter((column) => column.group === "q");
  const p = common.filter((column) => column.group === "p");
  const grid = rubato.section("Orbits", "orbit");
  const draw = (title, chosen) => rubato.portrait(rubato.card(grid, title), states, { ...chosen, title });
  if (q.length > 1) draw("Configuration", { x: q[0].name, y: q[1].name });
  if (p.length > 0) draw("Phase portrait", { x: q[0].name, y: p[0].name });
  const card = rubato.card(grid, "A coordinate against time", { wide: q.length > 1 });
  const note = rubato.element("figcaption", { class: "note" });
  let picture = null;
  const show = (name) => {
    if (picture) picture.remove();
    const series = states.map((one, i) => ({ label: `${letter(i)} ${name}`, colour: i, dash: i === 1 ? [5, 3] : undefined,
      ...rubato.overTime(one, one.columns.find((column) => column.name === name && column.group !== "exact")) }));
    picture = rubato.curve(card.body, { label: `${name} against time`, series, yLabel: name, height: q.length > 1 ? 280 : 340 });
    note.textContent = states.map((one, i) => rubato.thinningNote(one.count, series[i].x.length, `states of ${letter(i)}`)).filter(Boolean).join(" ");
    card.body.append(note);
  };
  card.control(rubato.select("coordinate", common.map(({ name }) => [name, name]), q[0].name, show), " ",
    rubato.button("Reset zoom", "Show all times", () => picture.reset()));
  show(q[0].name);
  rubato.player(states[0].t);
};

/** Fields of two lattices: profiles over each other where there is one space dimension, else maps side by side. */
rubato.comparedLattices = (records, letter) => {
  const maps = records.map(rubato.unpackMaps);
  const grid = rubato.section("Fields", "fields");
  maps[0].filter((map) => map.packed.group === "field").forEach((map) => {
    const other = maps[1].find((one) => one.packed.group === "field" && one.packed.name === map.packed.name);
    if (!other) return;
    const { name } = map.packed;
    [map, other].forEach((one, i) => rubato.mapPlane(rubato.card(grid, `${letter(i)}: field ${name}`).body, one, `Field ${name} of ${letter(i)}`));
    if (map.packed.shape === "film") return;
    const card = rubato.card(grid, `Profiles of ${name} at the same time`, { wide: true });
    const exact = maps[0].find((one) => one.packed.group === "exact" && one.packed.name === name);
    const entries = [{ map, label: `A ${name}`, colour: 0 }, { map: other, label: `B ${name}`, colour: 1, dash: [5, 3] }];
    rubato.profile(card.body, name, exact ? [...entries, { map: exact, label: "exact", colour: 2, dash: [2, 3] }] : entries);
  });
  const times = maps[0][0].first;
  rubato.player(times, times[times.length - 1]);
};
