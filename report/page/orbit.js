"use strict";

/** Curves that every record has. */
rubato.commonCurves = (() => {
  /** All curves of a record; those in full share the times of levels, steps or states. */
  const unpack = (data) => {
    const times = Object.fromEntries(Object.entries(data.times).map(([name, packed]) => [name, rubato.unpack.array(packed)]));
    return data.curves.map((curve) => ({ ...curve, x: curve.axis ? times[curve.axis] : rubato.unpack.array(curve.x), y: rubato.unpack.array(curve.y) }));
  };
  const magnitude = (curve) => ({ ...curve, y: Float64Array.from(curve.y, (value) => (value === 0 ? NaN : Math.abs(value))) });
  const offLaw = (data) => {
    const to = rubato.unpack.array(data.off_law.to);
    return Array.from(rubato.unpack.array(data.off_law.from), (from, i) => [from, to[i]]);
  };
  const roundingNote = (rounding) => (rounding > 0
    ? `Shaded: up to ${rubato.format.number(rounding, 2)}, what rounding alone leaves (\u03b5 times the terms of the law).` : null);

  /** A card with one picture of some curves, and what is to be said of it. */
  const show = (grid, title, curves, options = {}) => {
    if (curves.length === 0 || curves.every((curve) => curve.y.length === 0)) return;
    const card = rubato.card(grid, title, { wide: options.wide });
    const rounding = Math.max(0, ...curves.map((curve) => curve.rounding || 0));
    const picture = rubato.curve(card.body, { label: title, ...options, rounding,
      series: curves.map((curve, index) => ({ label: curve.label || curve.name, colour: curve.colour === undefined ? index : curve.colour, ...curve })) });
    card.control(rubato.button("Reset zoom", "Show all times", picture.reset));
    const thinned = curves.find((curve) => curve.count > curve.y.length);
    const undefinedOnes = curves.filter((curve) => curve.undefined > 0)
      .map((curve) => rubato.undefinedNote(curve.undefined, curve.count, curves.length > 1 ? `values of ${curve.label || curve.name}` : "values"));
    [options.note, options.rowsNote, roundingNote(rounding), ...undefinedOnes, thinned ? rubato.thinningNote(thinned.count, thinned.y.length, "values") : null]
      .filter(Boolean).forEach(card.note);
  };

  const all = (data) => {
    const curves = unpack(data);
    const group = (name) => curves.filter((curve) => curve.group === name);
    const byName = (name) => curves.filter((curve) => curve.name === name);
    const { rows, levels: levelCount } = data.level_rows;
    const rowsNote = rows < levelCount
      ? `The record has a row of ${rubato.format.count(rows)} of ${rubato.format.count(levelCount)} levels, which are drawn; the figures at the top are of all.` : null;
    const common = { offLaw: offLaw(data), rowsNote };
    const offLawNote = data.off_law_count > 0 ? `Shaded: steps off the energy law, in ${data.off_law_count} place${data.off_law_count === 1 ? "" : "s"}.` : null;
    const grid = rubato.section("Energy", "energy");
    const energies = group("energy").map((curve, index) => ({ ...curve, colour: index, label: curve.name === "discrete energy" ? "E\u2096 \u2212 E" : "H(z\u2096) \u2212 H(z\u2080)" }));
    show(grid, "Both energies: size of the deviation", energies.map(magnitude).map((curve) => ({ ...curve, label: `|${curve.label}|` })),
      { ...common, logarithmic: true, yLabel: "deviation", wide: true, height: 270,
        note: "On one logarithmic scale: the discrete energy is what the scheme conserves, the node energy is H at the levels. Zeros have no place on it." });
    energies.forEach((curve) => show(grid, curve.name === "discrete energy" ? "Discrete energy" : "Node energy", [curve],
      { ...common, yLabel: curve.label, note: `Deviation from ${rubato.format.number(curve.initial, 15)}.` }));
    const levels = rubato.section("Time levels", "levels");
    show(levels, "Step length", byName("h").map((curve) => ({ ...curve, label: "h\u2096", colour: 2 })), { ...common, yLabel: "h\u2096", note: offLawNote });
    show(levels, "\u0393", byName("gamma").map((curve) => ({ ...curve, label: "\u0393(z\u2096)", colour: 5 })), { ...common, yLabel: "\u0393", note: offLawNote });
    const gamma = byName("gamma").map(magnitude);
    const sizes = gamma.flatMap((curve) => Array.from(curve.y)).filter(Number.isFinite);
    const [smallest, largest] = sizes.reduce(([low, high], size) => [Math.min(low, size), Math.max(high, size)], [Infinity, 0]);
    if (largest > 100 * smallest) {
      show(levels, "Size of \u0393", gamma.map((curve) => ({ ...curve, label: "|\u0393(z\u2096)|", colour: 5 })), { ...common, yLabel: "|\u0393|", logarithmic: true });
    }
    show(levels, "Step condition", byName("step condition").map(magnitude).map((curve) => ({ ...curve, colour: 3 })),
      { ...common, yLabel: "relative error of h", logarithmic: true, note: "The relative error of h that rounding makes." });
    show(levels, "Iterations of the step", byName("iterations").map((curve) => ({ ...curve, colour: 4 })), { ...common, yLabel: "evaluations" });
    if (group("residual").length > 0) {
      const residuals = rubato.section("Local laws, step by step", "residuals");
      [...new Set(group("residual").map((curve) => curve.name.replace(/ (max|rms)$/, "")))].forEach((name) => {
        show(residuals, `Residual of ${name.replace("_", " ")}`, byName(`${name} max`).concat(byName(`${name} rms`)).map(magnitude)
          .map((curve) => ({ ...curve, label: curve.name.endsWith("max") ? "largest" : "root mean square" })), { ...common, yLabel: "residual", logarithmic: true });
      });
    }
    const kept = [...group("total").map((curve) => ({ ...curve, title: `Total ${curve.name}` })), ...group("invariant").map((curve) => ({ ...curve, title: curve.name }))];
    if (kept.length > 0) {
      const invariants = rubato.section("Totals and invariants", "invariants");
      kept.forEach((curve) => show(invariants, curve.title, [{ ...curve, label: "deviation", colour: 0 }],
        { ...common, yLabel: "deviation", note: `Deviation from ${rubato.format.number(curve.initial, 12)}, the first value that there is.` }));
    }
    if (group("output").length > 0) {
      const outputs = rubato.section("Quantities at the output times", "quantities");
      group("output").forEach((curve) => show(outputs, curve.name, [{ ...curve, colour: 1 }], { ...common, rowsNote: null, yLabel: curve.name }));
    }
  };
  return { all, show, unpack, magnitude, offLaw };
})();

/** The states of an orbit as packed by states.cpp. */
rubato.unpackStates = (packed) => ({ ...packed, t: rubato.unpack.array(packed.t),
  columns: packed.columns.map((column) => ({ ...column, values: rubato.unpack.array(column.values) })) });

/** Against time a column that the path thins has a selection of its own. */
rubato.overTime = (states, column) => (column.over_time
  ? { x: rubato.unpack.array(column.over_time.x), y: rubato.unpack.array(column.over_time.y) }
  : { x: states.t, y: column.values });

/**
 * The bodies of a problem that has nothing else, by the names of its coordinates: x1, y1, x2, y2 are the bodies 1 and 2;
 * the vectors `sun[3]` and `moon[3]` (sun1, sun2, sun3, …) are sun and moon. [{ name, columns }], none if there is but one.
 */
rubato.bodiesOf = (q) => {
  const grouped = (pattern, nameOf, placeOf) => {
    const bodies = new Map();
    for (const { name } of q) {
      const match = pattern.exec(name);
      if (!match) return [];
      const body = bodies.get(nameOf(match)) || [];
      bodies.set(nameOf(match), [...body, { name, place: placeOf(match) }]);
    }
    const all = [...bodies].map(([name, columns]) => ({ name, columns: columns.map((column) => column.name), places: columns.map(({ place }) => place).join() }));
    const areBodies = all.length > 1 && all.every(({ places }) => places === all[0].places && /^(x,y(,z)?|1,2(,3)?)$/.test(places));
    return areBodies ? all : [];
  };
  const byNumber = grouped(/^([xyz])_?(.+)$/, ([, , number]) => number, ([, letter]) => letter);
  return byNumber.length > 0 ? byNumber : grouped(/^(.+?)([123])$/, ([, name]) => name, ([, , place]) => place);
};

/** Coordinates, momenta and, of a problem stated by L, velocities against time, as many at once as the reader ticks. */
rubato.coordinates = (grid, states, offLaw) => {
  const own = states.columns.filter((column) => column.group !== "exact");
  const exact = states.columns.filter((column) => column.group === "exact");
  const q = own.filter((column) => column.group === "q");
  const hasVelocities = own.some((column) => column.group === "q_dot");
  const count = (hasVelocities ? 3 : 2) * states.coordinates;
  const kinds = hasVelocities ? "coordinates, momenta and velocities" : "coordinates and momenta";
  const card = rubato.card(grid, "Coordinates against time", { wide: q.length > 1 });
  const note = rubato.element("figcaption", { class: "note" });
  let picture = null;
  const draw = (names) => {
    const series = own.flatMap((column, index) => (names.includes(column.name)
      ? [{ column, label: column.name, colour: index }, ...exact.filter((one) => one.name === column.name)
        .map((one) => ({ column: one, label: `${one.name} exact`, colour: own.length + index, dash: [6, 4] }))]
      : [])).map(({ column, ...look }) => ({ ...look, ...rubato.overTime(states, column) }));
    if (picture) picture.remove();
    picture = null;
    if (series.length > 0) {
      picture = rubato.curve(card.body, { label: "Coordinates against time", series, yLabel: names.slice(0, 6).join(", ") + (names.length > 6 ? ", \u2026" : ""),
        offLaw, height: q.length > 1 ? 280 : 340 });
    }
    const shown = Math.max(0, ...series.map(({ x }) => x.length));
    note.textContent = [series.length === 0 ? "Nothing is chosen." : null, rubato.thinningNote(states.count, shown || states.count, "states"),
      `${names.length} of ${count} ${kinds} are drawn${names.length < own.length ? ": choose others above" : ""}.`,
      own.length < count ? `${count - own.length} more are in the record only.` : null].filter(Boolean).join(" ");
    card.body.append(note);
  };
  const first = q.slice(0, 4).map(({ name }) => name);
  card.control(rubato.choose("choose", own.map(({ name }) => [name, name]), first, draw), " ",
    rubato.button("Reset zoom", "Show all times", () => picture && picture.reset()));
  draw(first);
};

/** The page of an orbit. */
rubato.orbit = (data) => {
  const states = rubato.unpackStates(data.states);
  const q = states.columns.filter((column) => column.group === "q");
  const p = states.columns.filter((column) => column.group === "p");
  const isClocked = p.some(({ name }) => name === "minus_energy" || name === "minus_work");
  states.bodies = rubato.bodiesOf(isClocked ? q.filter(({ name }) => name !== "time") : q);

  const grid = rubato.section("Orbit", "orbit");
  const draw = (title, chosen) => rubato.portrait(rubato.card(grid, title), [states], { ...chosen, title });
  if (states.bodies.length > 0) draw("Configuration, all bodies", { bodies: [0, 1] });
  else if (q.length > 1) draw("Configuration", { x: q[0].name, y: q[1].name });
  draw("Phase portrait", { x: q[0].name, y: p[0].name });
  rubato.coordinates(grid, states, rubato.commonCurves.offLaw(data));
  rubato.commonCurves.unpack(data).filter((curve) => curve.group === "error").forEach((curve) => {
    rubato.commonCurves.show(grid, `Error in ${curve.name}`, [{ ...curve, label: "error", colour: 3 }], { yLabel: `${curve.name} \u2212 exact` });
  });
  rubato.sections(data);
  rubato.commonCurves.all(data);
  rubato.player(states.t);
};
