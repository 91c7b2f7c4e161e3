"use strict";

/**
 * The states of one or more orbits in a plane of two of their columns, chosen by the reader. rubato.portrait(card, orbits,
 * { title, x, y }); with { title, bodies: [i, j] } instead all bodies of the (one) orbit at once, components i and j of
 * each. States are joined by lines in pieces, which the page has chosen (path.cpp).
 */
rubato.portrait = (card, orbits, chosen) => {
  const choice = { ...chosen };
  const { bodies } = orbits[0];
  const hidden = new Set();
  const columnOf = (orbit, name) => orbit.columns.find((one) => one.name === name && one.group !== "exact") || { name: "t", values: orbit.t };

  /** [{ orbit, x, y, index }]: what is drawn, each in its own colour. */
  const paths = () => (choice.bodies
    ? bodies.map(({ columns }, index) => ({ orbit: orbits[0], index, x: columnOf(orbits[0], columns[choice.bodies[0]]), y: columnOf(orbits[0], columns[choice.bodies[1]]) }))
    : orbits.map((orbit, index) => ({ orbit, index, x: columnOf(orbit, choice.x), y: columnOf(orbit, choice.y) })))
    .filter(({ index }) => !hidden.has(index));

  const span = (arrays) => {
    let [low, high] = [Infinity, -Infinity];
    arrays.forEach((values) => values.forEach((value) => {
      if (value < low) low = value;
      if (value > high) high = value;
    }));
    if (!(low <= high)) return [0, 1];
    const pad = (high / 2 - low / 2 || Math.abs(high) / 2 || 0.5) * 0.1;
    return [low - pad, high + pad];
  };
  const extent = () => ({ x: span(paths().map((path) => path.x.values)), y: span(paths().map((path) => path.y.values)) });

  /** Positions are drawn to scale; a coordinate against its momentum or time is not. */
  const isToScale = () => {
    const [{ x, y } = { x: {}, y: {} }] = paths();
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

  const draw = (ctx, frame) => paths().forEach(({ orbit, x, y, index }) => {
    const { t, starts } = orbit;
    ctx.strokeStyle = rubato.colour.series(index);
    ctx.lineWidth = t.length > 50000 ? 0.6 : t.length > 4000 ? 0.8 : 1.2;
    ctx.lineJoin = "round";
    ctx.setLineDash(orbits.length > 1 && index > 0 ? [5, 3] : []);
    starts.forEach((from, piece) => {
      const to = piece + 1 < starts.length ? starts[piece + 1] : t.length;
      // One path of many thousand points is slow to stroke: pieces that share an end look the same.
      for (let begin = from; begin < to; begin += 2000) {
        ctx.beginPath();
        for (let i = begin; i < Math.min(to, begin + 2001); ++i) {
          const [left, top] = [frame.x(x.values[i]), frame.y(y.values[i])];
          if (Number.isFinite(left + top)) {
            ctx.lineTo(left, top);
          } else {  // a gap
            ctx.stroke();
            ctx.beginPath();
          }
        }
        ctx.stroke();
      }
    });
    ctx.setLineDash([]);
  });

  const mark = (ctx, frame) => {
    const all = paths();
    all.forEach(({ orbit, x, y, index }) => {
      const now = nearestIndex(orbit, rubato.clock.get());
      ctx.beginPath();
      ctx.arc(frame.x(x.values[now]), frame.y(y.values[now]), 5, 0, 2 * Math.PI);
      ctx.fillStyle = rubato.colour.series(orbits.length > 1 || choice.bodies ? index : 1);
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
    paths().forEach(({ orbit, x, y, index }) => orbit.t.forEach((time, i) => {
      const distance = Math.hypot(frame.x(x.values[i]) - left, frame.y(y.values[i]) - top);
      if (distance < best.distance) best = { distance, time, x: x.values[i], y: y.values[i], names: [x.name, y.name], index };
    }));
    const text = rubato.format.number;
    if (!best.names) return `${text(px, 5)}, ${text(py, 5)}`;
    const body = choice.bodies ? `${bodies[best.index].name}, ` : "";
    return `${body}t = ${text(best.time, 7)}: ${best.names[0]} = ${text(best.x)}, ${best.names[1]} = ${text(best.y)}`;
  };

  const { t } = orbits[0];
  const plane = rubato.plane(card.body, {
    label: choice.title, height: 400, extent: extent(), equal: isToScale, draw, mark, describe,
    xLabel: () => (choice.bodies ? `component ${choice.bodies[0] + 1}` : choice.x),
    yLabel: () => (choice.bodies ? `component ${choice.bodies[1] + 1}` : choice.y),
    step: (dx, dy) => rubato.clock.set(t[Math.min(t.length - 1, Math.max(0, nearestIndex(orbits[0], rubato.clock.get()) + (dx || dy)))]),
  });
  rubato.clock.watch(() => plane.remark());

  const show = () => plane.extend(extent());
  if (choice.bodies) {
    rubato.legend(card.body, bodies.map(({ name }, index) => [name, () => rubato.colour.series(index)]), (index, isShown) => {
      if (isShown) hidden.delete(index);
      else hidden.add(index);
      show();
    });
    const pairs = bodies[0].columns.length > 2 ? [[0, 1], [0, 2], [1, 2]] : [];
    if (pairs.length > 0) {
      card.control(rubato.select("components", pairs.map(([i, j]) => [`${i}${j}`, `${i + 1} and ${j + 1}`]), "01", (value) => {
        choice.bodies = [...value].map(Number);
        show();
      }), " ");
    }
  } else {
    const names = orbits[0].columns.filter((one) => one.group !== "exact" && orbits.every((orbit) => columnOf(orbit, one.name).group))
      .map((one) => [one.name, one.name]);
    const choose = (axis) => (value) => {
      choice[axis] = value;
      show();
    };
    card.control(rubato.select("across", [["t", "t"], ...names], choice.x, choose("x")), " ",
      rubato.select("up", names, choice.y, choose("y")), " ");
    if (orbits.length > 1) {
      rubato.legend(card.body, orbits.map((orbit, index) => [orbit.label, () => rubato.colour.series(index)]), (index, isShown) => {
        if (isShown) hidden.delete(index);
        else hidden.add(index);
        show();
      });
    }
  }
  card.control(rubato.button("Reset zoom", "Show the whole picture", plane.reset));
  const { count, percent, number } = rubato.format;
  const said = (orbit) => {
    const shown = orbit.t.length;
    if (shown === orbit.count) return `all ${count(shown)} stored states, joined in order`;
    const left = `${count(shown)} of ${count(orbit.count)} stored states are joined, ${percent(orbit.count - shown, orbit.count)} are left out`;
    const near = `none ${orbit.starts.length > 1 ? "between them " : ""}is farther from the lines than ${number(100 * orbit.deviation, 2)} % of the range of the coordinates`;
    return orbit.starts.length > 1
      ? `thinned: too many to be drawn as one line. ${count(orbit.starts.length)} pieces of the orbit, evenly spread over time; ${left}, and ${near} within a piece. A larger page (--max-size) shows more`
      : `thinned: ${left}; ${near}`;
  };
  const capital = (text) => text[0].toUpperCase() + text.slice(1);
  orbits.forEach((orbit) => card.note(`${orbits.length > 1 ? `${orbit.label}: ${said(orbit)}` : capital(said(orbit))}.`));
};
