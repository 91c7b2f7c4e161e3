"use strict";

/** Curves that every record has. */
rubato.commonCurves = (() => {
  const unpack = (curve) => ({ ...curve, x: rubato.unpack.array(curve.x), y: rubato.unpack.array(curve.y) });
  const magnitude = (curve) => ({ ...curve, y: Float64Array.from(curve.y, (value) => (value === 0 ? NaN : Math.abs(value))) });

  /** A card with one picture of some curves. */
  const show = (grid, title, curves, options = {}) => {
    if (curves.length === 0 || curves.every((curve) => curve.y.length === 0)) return;
    const card = rubato.card(grid, title, { wide: options.wide });
    const picture = rubato.curve(card.body, { label: title, ...options,
      series: curves.map((curve, index) => ({ label: curve.label || curve.name, colour: curve.colour === undefined ? index : curve.colour, ...curve })) });
    card.control(rubato.button("Reset zoom", "Show all times", picture.reset));
    const thinned = curves.find((curve) => curve.count > curve.y.length);
    if (options.note) card.note(options.note);
    if (thinned) card.note(rubato.thinningNote(thinned.count, thinned.y.length, "values"));
  };

  const all = (data) => {
    const curves = data.curves.map(unpack);
    const group = (name) => curves.filter((curve) => curve.group === name);
    const byName = (name) => curves.filter((curve) => curve.name === name);
    const bridges = data.bridges;
    const bridgeNote = data.bridge_count > 0 ? `Shaded: ${data.bridge_count} bridge${data.bridge_count === 1 ? "" : "s"}, where the energy law is not met.` : null;
    const grid = rubato.section("Energy", "energy");
    const energies = group("energy").map((curve, index) => ({ ...curve, colour: index, label: curve.name === "discrete energy" ? "E\u2096 \u2212 E\u2080" : "H(z\u2096) \u2212 H(z\u2080)" }));
    show(grid, "Both energies: size of the deviation", energies.map(magnitude).map((curve) => ({ ...curve, label: `|${curve.label}|` })),
      { logarithmic: true, yLabel: "deviation", wide: true, height: 270, bridges,
        note: "On one logarithmic scale: the discrete energy is what the scheme conserves, the node energy is H at the levels. Zeros are left out." });
    energies.forEach((curve) => show(grid, curve.name === "discrete energy" ? "Discrete energy" : "Node energy", [curve],
      { yLabel: curve.label, bridges, note: `First value ${rubato.format.number(curve.initial, 15)}.` }));
    const levels = rubato.section("Time levels", "levels");
    show(levels, "Step length", byName("h").map((curve) => ({ ...curve, label: "h\u2096", colour: 2 })), { yLabel: "h\u2096", bridges, note: bridgeNote });
    show(levels, "\u0393", byName("gamma").map((curve) => ({ ...curve, label: "\u0393(z\u2096)", colour: 5 })), { yLabel: "\u0393", bridges, note: bridgeNote });
    const gamma = byName("gamma").map(magnitude);
    const sizes = gamma.flatMap((curve) => Array.from(curve.y)).filter(Number.isFinite);
    const [smallest, largest] = sizes.reduce(([low, high], size) => [Math.min(low, size), Math.max(high, size)], [Infinity, 0]);
    if (largest > 100 * smallest) {
      show(levels, "Size of \u0393", gamma.map((curve) => ({ ...curve, label: "|\u0393(z\u2096)|", colour: 5 })), { yLabel: "|\u0393|", logarithmic: true, bridges });
    }
    show(levels, "Step condition", byName("step condition").map(magnitude).map((curve) => ({ ...curve, colour: 3 })),
      { yLabel: "relative error of h", logarithmic: true, bridges, note: "The relative error of h that rounding in H makes." });
    show(levels, "Iterations of the step", byName("iterations").map((curve) => ({ ...curve, colour: 4 })), { yLabel: "evaluations", bridges });
    if (group("residual").length > 0) {
      const residuals = rubato.section("Local laws, step by step", "residuals");
      [...new Set(group("residual").map((curve) => curve.name.replace(/ (max|rms)$/, "")))].forEach((name) => {
        show(residuals, `Residual of ${name.replace("_", " ")}`, byName(`${name} max`).concat(byName(`${name} rms`)).map(magnitude)
          .map((curve) => ({ ...curve, label: curve.name.endsWith("max") ? "largest" : "root mean square" })), { yLabel: "residual", logarithmic: true, bridges });
      });
    }
    const kept = [...group("total").map((curve) => ({ ...curve, title: `Total ${curve.name}` })), ...group("invariant").map((curve) => ({ ...curve, title: curve.name }))];
    if (kept.length > 0) {
      const invariants = rubato.section("Totals and invariants", "invariants");
      kept.forEach((curve) => show(invariants, curve.title, [{ ...curve, label: "deviation", colour: 0 }],
        { yLabel: "deviation", bridges, note: `Deviation from the first value, ${rubato.format.number(curve.initial, 12)}.` }));
    }
  };
  return { all, show, unpack, magnitude };
})();

/** The page of an orbit. */
rubato.orbit = (data) => {
  const states = { ...data.states, t: rubato.unpack.array(data.states.t),
    columns: data.states.columns.map((column) => ({ ...column, values: rubato.unpack.array(column.values) })) };
  const q = states.columns.filter((column) => column.group === "q");
  const p = states.columns.filter((column) => column.group === "p");
  const exact = states.columns.filter((column) => column.group === "exact");

  /** The vectors of a problem (`r = "r[3]"` has r1, r2, r3), if it has nothing else: each is a body. */
  const bodies = new Map();
  q.forEach(({ name }) => {
    const match = /^(.*?)([123])$/.exec(name);
    if (match) bodies.set(match[1], [...(bodies.get(match[1]) || []), name]);
  });
  const vectors = [...bodies.values()];
  const allAlike = vectors.every((names) => names.length === vectors[0].length && names.length > 1);
  states.bodies = allAlike && vectors.flat().length === q.length ? vectors : [];

  const grid = rubato.section("Orbit", "orbit");
  const draw = (title, chosen) => rubato.portrait(rubato.card(grid, title), [states], { ...chosen, title });
  const many = states.bodies.length > 1;
  if (many) draw("Configuration, all bodies", { x: "bodies", y: "bodies" });
  else if (q.length > 1) draw("Configuration", { x: q[0].name, y: q[1].name });
  draw("Phase portrait", { x: q[0].name, y: p[0].name });
  const few = q.slice(0, 4);
  const note = [rubato.thinningNote(states.count, states.t.length, "states"),
    q.length > few.length ? `The first ${few.length} of ${states.coordinates} coordinates; choose others above.` : null].filter(Boolean).join(" ");
  rubato.commonCurves.show(grid, "Coordinates against time", [...few.map((column, index) => ({ name: column.name, x: states.t, y: column.values, colour: index, count: 0 })),
    ...exact.filter((column) => few.some((one) => one.name === column.name))
      .map((column) => ({ name: `${column.name} exact`, x: states.t, y: column.values, colour: few.length + few.findIndex((one) => one.name === column.name), dash: [6, 4], count: 0 }))],
  { yLabel: few.map((column) => column.name).join(", "), bridges: data.bridges, note: note || undefined, wide: q.length > 1, height: q.length > 1 ? 280 : 408 });
  exact.forEach((column) => {
    const own = states.columns.find((one) => one.name === column.name && one.group !== "exact");
    if (own) {
      rubato.commonCurves.show(grid, `Error in ${column.name}`, [{ name: "error", x: states.t, y: own.values.map((value, i) => value - column.values[i]), count: 0, colour: 3 }],
        { yLabel: `${column.name} \u2212 exact`, note: "Rounded to single precision in this page." });
    }
  });
  rubato.commonCurves.all(data);
  rubato.player(states.t);
};
