"use strict";

/**
 * Profiles along space at the time of the clock, laid over each other: rubato.profile(host, name, entries) with entries
 * [{ map, label, colour, dash? }]. Where cells are
 * thinned both the largest and the smallest values of their blocks are drawn.
 */
rubato.profile = (host, name, entries) => {
  const own = entries.map((entry) => ({ ...entry, x: Array.from({ length: entry.map.columns }, (_, i) => entry.map.x.centre(i)) }));
  const row = ({ map, x }, coded, t) => {
    const first = map.place(t) * map.columns;
    return x.map((_, i) => coded.value(coded.codes[first + i]));
  };
  const series = (t) => own.flatMap((entry) => {
    const { map, x, label, colour, dash } = entry;
    const { high, low } = map.profile;
    const line = { label, x, y: row(entry, high, t), colour, dash, width: 1.7 };
    return low ? [line, { ...line, label: `${label} (smallest)`, y: row(entry, low, t), width: 1 }] : [line];
  });
  const bounds = own.flatMap(({ map }) => [map.profile.high.minimum, map.profile.high.maximum]);
  const [low, high] = [Math.min(...bounds), Math.max(...bounds)];
  const pad = (high - low || 1) * 0.06;
  const curve = rubato.curve(host, {
    label: `Profile of ${name}`, series: series(rubato.clock.get()), xLabel: own[0].map.x.name, yLabel: name,
    time: false, height: 190, right: 86, range: () => [low - pad, high + pad],
  });
  rubato.clock.watch((t) => curve.replace(series(t)));
  return curve;
};
