"use strict";

/**
 * Profiles along space at the time of the clock, laid over each other: rubato.profile(host, name, entries) with entries
 * [{ map, label, colour, dash? }]. Of a thinned map both the largest and the smallest values of the blocks are drawn.
 */
rubato.profile = (host, name, entries) => {
  const own = entries.map((entry) => ({ ...entry, x: Array.from({ length: entry.map.columns }, (_, i) => entry.map.x.centre(i)) }));
  const row = ({ map, x }, coded, t) => {
    const first = map.place(t) * map.columns;
    return x.map((_, i) => coded.value(coded.codes[first + i]));
  };
  const series = (t) => own.flatMap((entry) => {
    const { map, x, label, colour, dash } = entry;
    const high = { label, x, y: row(entry, map.high, t), colour, dash, width: 1.7 };
    return map.packed.thinned ? [high, { label: `${label} (smallest)`, x, y: row(entry, map.low, t), colour, dash, width: 1 }] : [high];
  });
  const bounds = own.flatMap(({ map }) => [map.packed.high.minimum, map.packed.high.maximum]);
  const [low, high] = [Math.min(...bounds), Math.max(...bounds)];
  const pad = (high - low || 1) * 0.06;
  const curve = rubato.curve(host, {
    label: `Profile of ${name}`, series: series(rubato.clock.get()), xLabel: own[0].map.x.name, yLabel: name,
    time: false, height: 190, right: 74, range: () => [low - pad, high + pad],
  });
  rubato.clock.watch((t) => curve.replace(series(t)));
  return curve;
};
