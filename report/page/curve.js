"use strict";

/**
 * Curves over time (or over space), drawn by uPlot. rubato.curve(host, options) with
 *   label    what the picture shows, for screen readers
 *   series   [{ label, x, y, dash?, fill? }], NaN and null are gaps; each has its own x
 *   xLabel, yLabel, logarithmic, height
 *   time     whether x is time: cursors and zoom are then shared with all other curves over time
 *   offLaw  [[t, t], …] to be marked
 *   rounding the size below which values are rounding: shaded, and never the whole picture
 * answers { plot, replace(series), reset(), remove() }.
 */
rubato.curve = (() => {
  let spreading = false;

  /** uPlot wants ascending x, and null for gaps. */
  const ordered = ({ x, y }) => {
    const xs = Array.from(x);
    const ys = Array.from(y, (value) => (Number.isFinite(value) ? value : null));
    return xs.length > 1 && xs[0] > xs[xs.length - 1] ? [xs.reverse(), ys.reverse()] : [xs, ys];
  };
  const table = (series) => {
    const all = series.map(ordered);
    const isShared = series.every(({ x }) => x === series[0].x);
    return isShared && all.length > 0 ? [all[0][0], ...all.map(([, y]) => y)] : uPlot.join(all);
  };

  /** The nearest index at which a series has a value: curves joined from different selections have holes. */
  const nearest = (plot, index, hovered) => {
    const values = plot.data[index];
    if (index === 0 || hovered === null || (values[hovered] !== undefined && values[hovered] !== null)) return hovered;
    for (let distance = 1; distance < 400; ++distance) {
      for (const candidate of [hovered - distance, hovered + distance]) {
        if (values[candidate] !== undefined && values[candidate] !== null) return candidate;
      }
    }
    return hovered;
  };

  const markOffLaw = (offLaw) => (plot) => {
    const { ctx } = plot;
    ctx.save();
    ctx.fillStyle = rubato.theme.colour("off-law");
    offLaw.forEach(([from, to]) => {
      const left = plot.valToPos(from, "x", true);
      const right = plot.valToPos(to, "x", true);
      const width = Math.max(Math.abs(right - left), 2 * devicePixelRatio);
      ctx.fillRect(Math.min(left, right), plot.bbox.top, width, plot.bbox.height);
    });
    ctx.restore();
  };

  /** Where values are no more than rounding: from -size to size, or on a logarithmic scale below it. */
  const markRounding = (size, logarithmic) => (plot) => {
    const { ctx, bbox } = plot;
    const place = (value) => Math.min(bbox.top + bbox.height, Math.max(bbox.top, plot.valToPos(value, "y", true)));
    const top = place(logarithmic ? Math.log10(size) : size);
    const bottom = logarithmic ? bbox.top + bbox.height : place(-size);
    ctx.save();
    ctx.fillStyle = rubato.theme.colour("rounding");
    ctx.fillRect(bbox.left, top, bbox.width, bottom - top);
    if (bottom - top > 14 * devicePixelRatio) {
      ctx.fillStyle = rubato.theme.colour("faint");
      ctx.font = rubato.theme.font(11 * devicePixelRatio);
      ctx.textAlign = "right";
      ctx.textBaseline = "top";
      ctx.fillText(`rounding: ${rubato.format.number(size, 2)}`, bbox.left + bbox.width - 6 * devicePixelRatio, top + 3 * devicePixelRatio);
    }
    ctx.restore();
  };
  /** A range that shows rounding as small as it is: a twelfth of the picture, or a third of at least six decades. */
  const withRounding = (size, logarithmic, range) => (plot, low, high) => {
    const [from, to] = range(plot, low, high);
    if (!logarithmic) return [Math.min(from, -6 * size), Math.max(to, 6 * size)];
    const level = Math.log10(size);
    return low === null ? [level - 2, level + 4] : [Math.min(from, level - 2), Math.max(to, level + 4)];
  };

  const spreadZoom = (plot, key) => {
    if (key !== "x" || spreading) return;
    const { min, max } = plot.scales.x;
    spreading = true;
    rubato.pictures.curves.forEach(({ plot: other, time }) => {
      if (time && other !== plot && (other.scales.x.min !== min || other.scales.x.max !== max)) other.setScale("x", { min, max });
    });
    spreading = false;
  };

  /**
   * A logarithmic picture is a plain one of log10: uPlot's own logarithmic scale does not end for values below 1e-23.
   * Zero has no place on it, and is a gap.
   */
  const logarithms = (one) => ({ ...one, y: Float64Array.from(one.y, (value) => (value > 0 ? Math.log10(value) : NaN)) });
  const decades = (low, high, room) => {
    const every = Math.max(1, Math.ceil((high - low) / room));
    const values = rubato.format.ticks(Math.ceil(low / every), Math.floor(high / every), Infinity).map((value) => value * every);
    return high - low < 1.5 ? rubato.format.ticks(low, high, room) : values;
  };
  const powerTexts = (values) => values.map((value) => (Number.isInteger(value) ? rubato.format.power(value) : rubato.format.number(10 ** value, 2)));

  /** Some room above and below, also where all values are equal or uPlot would call their range nothing. */
  const padded = (plot, low, high) => {
    if (low === null || high === null) return [0, 1];
    const pad = (high / 2 - low / 2) * 0.16 || Math.abs(high) * 0.1 || 1;
    return [low - pad, high + pad];
  };

  /** Few values, or single ones between gaps, which no line shows. */
  const isSparse = (values) => {
    const has = (i) => values[i] !== null && values[i] !== undefined;
    let count = 0;
    let isAlone = false;
    for (let i = 0; i < values.length; ++i) {
      if (!has(i)) continue;
      ++count;
      isAlone = isAlone || (values[i - 1] === null && values[i + 1] === null);
    }
    return count < 40 || isAlone;
  };

  const axis = (label, splits, values, size) => ({
    label, splits, values: (plot, all) => values(all), size, labelSize: 20, gap: 4, font: rubato.theme.font(12), labelFont: rubato.theme.font(12.5), labelGap: 0,
    stroke: () => rubato.theme.colour("faint"),
    grid: { stroke: () => rubato.theme.colour("grid"), width: 1 },
    ticks: { stroke: () => rubato.theme.colour("line"), width: 1, size: 5 },
  });

  const keys = (host, curve) => host.addEventListener("keydown", (event) => {
    const { plot } = curve;
    const { min, max } = plot.scales.x;
    const middle = (min + max) / 2;
    const zoom = (factor) => plot.setScale("x", { min: middle - (max - min) * factor / 2, max: middle + (max - min) * factor / 2 });
    const move = (pixels) => plot.setCursor({ left: Math.max(0, (plot.cursor.left < 0 ? plot.over.clientWidth / 2 : plot.cursor.left) + pixels), top: 10 });
    const actions = {
      ArrowLeft: () => move(-4), ArrowRight: () => move(4), "+": () => zoom(0.5), "-": () => zoom(2), "0": curve.reset, Escape: curve.reset,
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });

  return (host, options) => {
    const { label, series, xLabel = "t", yLabel = "", logarithmic = false, height = 230, time = true, offLaw = [], right = 24, rounding = 0 } = options;
    const range = rounding > 0 ? withRounding(rounding, logarithmic, options.range || padded) : options.range || padded;
    const holder = rubato.element("div", { class: "curve", tabindex: "0", role: "group",
      "aria-label": `${label}. Arrow keys move the cursor, plus and minus zoom, 0 shows all.` });
    host.append(holder);
    const lines = (all) => all.map((one, index) => ({
      label: one.label,
      stroke: () => rubato.colour.series(one.colour === undefined ? index : one.colour),
      width: one.width || 1.4, dash: one.dash, points: { show: (self, index) => isSparse(self.data[index]), size: 5 }, spanGaps: false,
      value: (plot, value) => rubato.format.number(logarithmic && value !== null ? 10 ** value : value, one.digits || 6),
    }));
    const prepared = (all) => table(logarithmic ? all.map(logarithms) : all);
    const { ticks, tickTexts } = rubato.format;
    const across = (plot, index, low, high) => ticks(low, high, Math.max(2, (plot.width - 100) / 80));
    const up = (plot, index, low, high) => (logarithmic ? decades : ticks)(low, high, Math.max(3, (plot.height - 60) / 36));
    const plot = new uPlot({
      width: Math.max(holder.clientWidth, 240), height,
      padding: [10, right, 0, 0],
      scales: { x: { time: false }, y: { range } },
      axes: [axis(xLabel, across, tickTexts, 28), axis(yLabel, up, logarithmic ? powerTexts : tickTexts, 62)],
      series: [{ label: xLabel, value: (self, value) => rubato.format.number(value, 7) }, ...lines(series)],
      cursor: {
        dataIdx: nearest, drag: { x: true, y: false, setScale: true },
        sync: time ? { key: "t", scales: ["x", null], setSeries: false } : undefined,
        points: { size: 6 },
      },
      hooks: { drawClear: [...(rounding > 0 ? [markRounding(rounding, logarithmic)] : []), markOffLaw(offLaw)], setScale: time ? [spreadZoom] : [], draw: [(self) => { moveClock(self); }] },
    }, prepared(series), holder);

    let isGone = false;
    const now = rubato.element("div", { class: "now", hidden: "" });
    plot.over.append(now);
    function moveClock(self) {
      if (!time || isGone || !now.isConnected) return;
      const left = self.valToPos(rubato.clock.get(), "x");
      now.hidden = !(left >= 0 && left <= self.over.clientWidth);
      now.style.left = `${left}px`;
    }
    const curve = {
      /** Takes the picture away: others may take its place. */
      remove: () => {
        isGone = true;
        sizes.disconnect();
        rubato.pictures.curves.splice(rubato.pictures.curves.indexOf(curve), 1);
        plot.destroy();
        holder.remove();
      },
      plot,
      time,
      replace: (next) => plot.setData(prepared(next), false),
      /** All of x, on every curve that shares it. */
      reset: () => {
        const xs = plot.data[0];
        plot.setScale("x", { min: xs[0], max: xs[xs.length - 1] });
      },
    };
    const sizes = new ResizeObserver(() => {
      if (holder.clientWidth > 0 && holder.clientWidth !== plot.width) plot.setSize({ width: holder.clientWidth, height });
    });
    if (time) {
      rubato.clock.watch(() => moveClock(plot));
      moveClock(plot);
    }
    rubato.pictures.curves.push(curve);
    keys(holder, curve);
    rubato.theme.watch(() => { if (!isGone) plot.redraw(false, true); });
    sizes.observe(holder);
    return curve;
  };
})();
