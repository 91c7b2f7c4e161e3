"use strict";

/** The profile of a field at the time of the clock, under its map, with the exact solution over it where there is one. */
rubato.profile = (host, map, exact) => {
  const x = Array.from({ length: map.columns }, (_, i) => map.x.centre(i));
  const at = (source, coded, row) => x.map((_, i) => coded.value(coded.codes[row * source.columns + i]));
  const series = (t) => {
    const row = map.place(t);
    const lines = [{ label: map.packed.name, x, y: at(map, map.high, row), colour: 0, width: 1.8 }];
    if (map.packed.thinned) lines.push({ label: "smallest", x, y: at(map, map.low, row), colour: 0, width: 1 });
    if (exact) lines.push({ label: "exact", x, y: at(exact, exact.high, exact.place(t)), colour: 1, dash: [6, 4], width: 1.6 });
    return lines;
  };
  if (map.packed.thinned) map.largestLabel = "largest";
  const bounds = [map, ...(exact ? [exact] : [])].flatMap((one) => [one.packed.high.minimum, one.packed.high.maximum]);
  const [low, high] = [Math.min(...bounds), Math.max(...bounds)];
  const pad = (high - low || 1) * 0.06;
  const curve = rubato.curve(host, {
    label: `Profile of ${map.packed.name}`, series: series(rubato.clock.get()), xLabel: map.x.name, yLabel: map.packed.name,
    time: false, height: 190, right: 74, range: () => [low - pad, high + pad],
  });
  rubato.clock.watch((t) => curve.replace(series(t)));
  return curve;
};
