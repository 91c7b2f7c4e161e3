"use strict";

/**
 * The states of one or more orbits in a plane of two of their columns, chosen by the reader. rubato.portrait(card, orbits,
 * { title, x, y }); the y "bodies" stands for all bodies of the (one) orbit at once. All stored states are joined by a line
 * if the page has them all; else the first are joined, and those of the envelope are dots.
 */
rubato.portrait = (card, orbits, chosen) => {
  const choice = { ...chosen };
  const isWhole = (orbit) => orbit.t.length === orbit.count;
  const columnOf = (orbit, name) => orbit.columns.find((one) => one.name === name) || { name: "t", values: orbit.t };

  /** [{ orbit, x, y }]: what is drawn, each in its own colour. */
  const paths = () => (choice.y === "bodies"
    ? orbits[0].bodies.map(([x, y]) => ({ orbit: orbits[0], x: columnOf(orbits[0], x), y: columnOf(orbits[0], y) }))
    : orbits.map((orbit) => ({ orbit, x: columnOf(orbit, choice.x), y: columnOf(orbit, choice.y) })));

  const span = (arrays) => {
    let [low, high] = [Infinity, -Infinity];
    arrays.forEach((values) => values.forEach((value) => {
      if (value < low) low = value;
      if (value > high) high = value;
    }));
    const pad = (high - low || 1) * 0.05;
    return [low - pad, high + pad];
  };
  const extent = () => ({ x: span(paths().map((path) => path.x.values)), y: span(paths().map((path) => path.y.values)) });

  /** Positions are drawn to scale; a coordinate against its momentum or time is not. */
  const isToScale = () => {
    const { x, y } = paths()[0];
    return x.group !== undefined && x.group === y.group;
  };

  const nearestIndex = ({ t }, time) => {
    let [from, to] = [0, t.length - 1];
    const sign = Math.sign(t[to] - t[0]) || 1;
    while (to - from > 1) {
      const middle = (from + to) >> 1;
      if ((t[middle] - time) * sign <= 0) from = middle;
      else to = middle;
    }
    return Math.abs(t[from] - time) <= Math.abs(t[to] - time) ? from : to;
  };

  const draw = (ctx, frame) => paths().forEach(({ orbit, x, y }, index) => {
    const { t, lead } = orbit;
    ctx.strokeStyle = rubato.colour.series(index);
    ctx.fillStyle = ctx.strokeStyle;
    if (!isWhole(orbit)) {
      ctx.globalAlpha = 0.55;
      for (let i = lead; i < t.length; ++i) ctx.fillRect(frame.x(x.values[i]) - 0.75, frame.y(y.values[i]) - 0.75, 1.5, 1.5);
      ctx.globalAlpha = 1;
    }
    ctx.lineWidth = lead > 4000 ? 0.8 : 1.2;
    ctx.lineJoin = "round";
    ctx.setLineDash(orbits.length > 1 && index > 0 ? [5, 3] : []);
    ctx.beginPath();
    for (let i = 0; i < lead; ++i) ctx.lineTo(frame.x(x.values[i]), frame.y(y.values[i]));
    ctx.stroke();
    ctx.setLineDash([]);
  });

  const mark = (ctx, frame) => {
    const all = paths();
    all.forEach(({ orbit, x, y }, index) => {
      const now = nearestIndex(orbit, rubato.clock.get());
      ctx.beginPath();
      ctx.arc(frame.x(x.values[now]), frame.y(y.values[now]), 5, 0, 2 * Math.PI);
      ctx.fillStyle = rubato.colour.series(all.length > 1 ? index : 1);
      ctx.strokeStyle = rubato.theme.colour("card");
      ctx.lineWidth = 2;
      ctx.fill();
      ctx.stroke();
      ctx.lineWidth = 1;
    });
  };

  /** The values of the state nearest to the pointer. */
  const describe = (px, py, frame) => {
    if (px === null) return " ";
    const [left, top] = [frame.x(px), frame.y(py)];
    let best = { distance: 30 };
    paths().forEach(({ orbit, x, y }) => orbit.t.forEach((time, i) => {
      const distance = Math.hypot(frame.x(x.values[i]) - left, frame.y(y.values[i]) - top);
      if (distance < best.distance) best = { distance, time, x: x.values[i], y: y.values[i], names: [x.name, y.name] };
    }));
    const text = rubato.format.number;
    if (!best.names) return `${text(px, 5)}, ${text(py, 5)}`;
    return `t = ${text(best.time, 7)}: ${best.names[0]} = ${text(best.x)}, ${best.names[1]} = ${text(best.y)}`;
  };

  const { t } = orbits[0];
  const plane = rubato.plane(card.body, {
    label: choice.title, height: 400, extent: extent(), equal: isToScale, draw, mark, describe,
    xLabel: () => (choice.y === "bodies" ? "first coordinate" : choice.x),
    yLabel: () => (choice.y === "bodies" ? "second coordinate" : choice.y),
    step: (dx, dy) => rubato.clock.set(t[Math.min(t.length - 1, Math.max(0, nearestIndex(orbits[0], rubato.clock.get()) + (dx || dy)))]),
  });
  rubato.clock.watch(() => plane.remark());

  if (choice.y !== "bodies") {
    const names = orbits[0].columns.filter((one) => one.group !== "exact" && orbits.every((orbit) => columnOf(orbit, one.name).group))
      .map((one) => [one.name, one.name]);
    const choose = (axis) => (value) => {
      choice[axis] = value;
      plane.extend(extent());
    };
    card.control(rubato.select("across", [["t", "t"], ...names], choice.x, choose("x")), " ",
      rubato.select("up", names, choice.y, choose("y")), " ");
  }
  card.control(rubato.button("Reset zoom", "Show the whole picture", plane.reset));
  const thinned = orbits.find((orbit) => !isWhole(orbit));
  const count = (value) => value.toLocaleString("en");
  card.note(thinned ? `Thinned: the line joins the first ${count(thinned.lead)} of ${count(thinned.count)} stored states; the ` +
      `${count(thinned.t.length - thinned.lead)} dots are, of each run of consecutive states, those where a coordinate is smallest or largest.`
    : `All ${orbits.map((orbit) => count(orbit.count)).join(" and ")} stored states, joined in order.`);
};
