"use strict";

/**
 * An orbit's states in a plane of two of its columns, chosen by the reader. All stored states are joined by a line if
 * the page has them all; else the first are joined, and those of the envelope are dots.
 */
rubato.portrait = (card, states, chosen) => {
  const { columns, t, lead, count } = states;
  const whole = t.length === count;
  const choice = { ...chosen };
  const column = (name) => columns.find((one) => one.name === name) || { name: "t", values: t };
  const extentOf = (values) => {
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
    const pad = (high - low || 1) * 0.05;
    return [low - pad, high + pad];
  };
  const paths = () => (choice.y === "bodies" ? states.bodies.map((body) => [column(body[0]), column(body[1])]) : [[column(choice.x), column(choice.y)]]);
  const extent = () => {
    const all = paths().map(([x, y]) => [extentOf(x.values), extentOf(y.values)]);
    const span = (axis) => [Math.min(...all.map((one) => one[axis][0])), Math.max(...all.map((one) => one[axis][1]))];
    return { x: span(0), y: span(1) };
  };
  const sameKind = () => {
    if (choice.y === "bodies") return true;
    const [x, y] = [column(choice.x), column(choice.y)];
    return x.group !== undefined && x.group === y.group;
  };
  const nearestIndex = (time) => {
    let [from, to] = [0, t.length - 1];
    const sign = Math.sign(t[to] - t[0]) || 1;
    while (to - from > 1) {
      const middle = (from + to) >> 1;
      if ((t[middle] - time) * sign <= 0) from = middle;
      else to = middle;
    }
    return Math.abs(t[from] - time) <= Math.abs(t[to] - time) ? from : to;
  };
  const plane = rubato.plane(card.body, {
    label: card.title, height: 400, extent: extent(), equal: sameKind,
    xLabel: () => (choice.y === "bodies" ? "first coordinate" : choice.x),
    yLabel: () => (choice.y === "bodies" ? "second coordinate" : choice.y),
    draw: (ctx, frame) => paths().forEach(([x, y], index) => {
      ctx.strokeStyle = rubato.colour.series(index);
      ctx.fillStyle = ctx.strokeStyle;
      if (!whole) {
        ctx.globalAlpha = 0.55;
        for (let i = lead; i < t.length; ++i) ctx.fillRect(frame.x(x.values[i]) - 0.75, frame.y(y.values[i]) - 0.75, 1.5, 1.5);
        ctx.globalAlpha = 1;
      }
      ctx.lineWidth = lead > 4000 ? 0.8 : 1.2;
      ctx.lineJoin = "round";
      ctx.beginPath();
      for (let i = 0; i < lead; ++i) ctx.lineTo(frame.x(x.values[i]), frame.y(y.values[i]));
      ctx.stroke();
    }),
    mark: (ctx, frame) => {
      const now = nearestIndex(rubato.clock.get());
      paths().forEach(([x, y], index) => {
        ctx.beginPath();
        ctx.arc(frame.x(x.values[now]), frame.y(y.values[now]), 5, 0, 2 * Math.PI);
        ctx.fillStyle = rubato.colour.series(paths().length > 1 ? index : 1);
        ctx.strokeStyle = rubato.theme.colour("card");
        ctx.lineWidth = 2;
        ctx.fill();
        ctx.stroke();
        ctx.lineWidth = 1;
      });
    },
    describe: (px, py, frame) => {
      if (px === null) return " ";
      let best = null;
      paths().forEach(([x, y]) => {
        for (let i = 0; i < t.length; ++i) {
          const distance = Math.hypot(frame.x(x.values[i]) - frame.x(px), frame.y(y.values[i]) - frame.y(py));
          if (!best || distance < best.distance) best = { distance, i, x, y };
        }
      });
      if (!best || best.distance > 30) return `${rubato.format.number(px, 5)}, ${rubato.format.number(py, 5)}`;
      return `t = ${rubato.format.number(t[best.i], 7)}: ${best.x.name} = ${rubato.format.number(best.x.values[best.i])}, ` +
        `${best.y.name} = ${rubato.format.number(best.y.values[best.i])}`;
    },
    step: (dx, dy) => rubato.clock.set(t[Math.min(t.length - 1, Math.max(0, nearestIndex(rubato.clock.get()) + (dx || dy)))]),
  });
  rubato.clock.watch(() => plane.remark());
  const names = columns.filter((one) => one.group !== "exact").map((one) => [one.name, one.name]);
  const choose = (axis) => (value) => {
    choice[axis] = value;
    plane.extend(extent());
  };
  if (choice.y !== "bodies") {
    card.control(rubato.select("across", [["t", "t"], ...names], choice.x, choose("x")), " ",
      rubato.select("up", names, choice.y, choose("y")), " ");
  }
  card.control(rubato.button("Reset zoom", "Show the whole picture", plane.reset));
  card.note(whole ? `All ${count.toLocaleString("en")} stored states, joined in order.`
    : `Thinned: the line joins the first ${lead.toLocaleString("en")} of ${count.toLocaleString("en")} stored states; the ` +
      `${(t.length - lead).toLocaleString("en")} dots are, of each run of consecutive states, those where a coordinate is smallest or largest.`);
};
