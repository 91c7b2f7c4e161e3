"use strict";

/** The page of an ensemble: what was given against what came of it, orbits and sections of all members over each other. */
rubato.ensemble = (() => {
  const { number, count } = rubato.format;

  const unpack = (data) => data.members.columns.map((column) => ({ ...column, values: rubato.unpack.array(column.values) }));

  /** The least and the largest of the finite ones; a width where there is none. */
  const range = (values) => {
    let [low, high] = [Infinity, -Infinity];
    values.forEach((value) => { if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); } });
    if (low > high) return [0, 1];
    return high > low ? [low, high] : [low - (Math.abs(low) / 2 || 0.5), high + (Math.abs(high) / 2 || 0.5)];
  };
  const padded = ([low, high], part = 0.05) => [low - (high - low) * part, high + (high - low) * part];

  /** The colour of a value of a column: of one that stands for words a colour each. */
  const scale = ({ values, words }) => {
    const [low, high] = range(values);
    return {
      range: [low, high],
      css: (value) => (!Number.isFinite(value) ? "transparent" : words.length > 0 ? rubato.colour.series(value)
        : rubato.colour.css(rubato.colour.sequential()[Math.round(255 * Math.min(1, Math.max(0, (value - low) / (high - low))))])),
    };
  };
  const bar = (ctx, frame, column) => {
    if (column.words.length === 0) {
      rubato.drawColourBar(ctx, frame, { colours: rubato.colour.sequential, rounding: null, range: scale(column).range, packed: { logarithmic: false } });
      return;
    }
    ctx.font = rubato.theme.font(11.5);
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    column.words.forEach((word, i) => {
      const [left, top] = [frame.left + frame.width + 12, frame.top + 10 + 18 * i];
      ctx.fillStyle = rubato.colour.series(i);
      ctx.fillRect(left, top - 6, 12, 12);
      ctx.fillStyle = rubato.theme.colour("faint");
      ctx.fillText(word, left + 17, top, 57);
    });
  };

  const textOf = (column, value) => (column.words.length > 0 && column.words[value] !== undefined ? column.words[value] : number(value, 5));
  const options = (columns) => columns.map(({ label }, index) => [`${index}`, label]);

  /** Two columns of which every pair of values is there once: [xs, ys, member at (i, j)], or null. */
  const gridOf = (x, y) => {
    const distinct = (values) => [...new Set(values)].sort((a, b) => a - b);
    const [xs, ys] = [distinct(x.values), distinct(y.values)];
    if (xs.length < 2 || ys.length < 2 || xs.length * ys.length !== x.values.length) return null;
    const member = new Int32Array(x.values.length).fill(-1);
    const place = (list) => new Map(list.map((value, i) => [value, i]));
    const [columnOf, rowOf] = [place(xs), place(ys)];
    x.values.forEach((value, m) => { member[rowOf.get(y.values[m]) * xs.length + columnOf.get(value)] = m; });
    return member.includes(-1) ? null : { xs, ys, member };
  };
  /** Half way between neighbours, and as far beyond the first and the last one. */
  const edges = (values) => Float64Array.from({ length: values.length + 1 }, (_, i) => (i === 0 ? values[0] - (values[1] - values[0]) / 2
    : i === values.length ? values[i - 1] + (values[i - 1] - values[i - 2]) / 2 : (values[i - 1] + values[i]) / 2));
  const indexIn = (borders, value) => {
    for (let i = 0; i + 1 < borders.length; ++i) if (value >= borders[i] && value < borders[i + 1]) return i;
    return -1;
  };

  const thinned = (members) => (members.stride > 1
    ? `Thinned: every ${members.stride}th of ${count(members.count)} members is drawn.` : `All ${count(members.count)} members.`);

  /** A map over two entries that were scanned together: of basins, say. */
  const map = (grid, x, y, shown, members) => {
    const cells = gridOf(x, y);
    if (!cells) return false;
    const [xEdges, yEdges] = [edges(cells.xs), edges(cells.ys)];
    const card = rubato.card(grid, `Map over ${x.label} and ${y.label}`, { wide: true });
    let column = shown[0];
    const draw = (ctx, frame) => {
      const { css } = scale(column);
      cells.ys.forEach((_, j) => cells.xs.forEach((__, i) => {
        const [left, right] = [frame.x(xEdges[i]), frame.x(xEdges[i + 1])];
        const [top, bottom] = [frame.y(yEdges[j + 1]), frame.y(yEdges[j])];
        ctx.fillStyle = css(column.values[cells.member[j * cells.xs.length + i]]);
        ctx.fillRect(left, top, right - left + 0.5, bottom - top + 0.5);
      }));
    };
    const describe = (a, b) => {
      if (a === null) return " ";
      const [i, j] = [indexIn(xEdges, a), indexIn(yEdges, b)];
      if (i < 0 || j < 0) return " ";
      const member = cells.member[j * cells.xs.length + i];
      return `member ${count(member * members.stride)}: ${x.label} = ${textOf(x, cells.xs[i])}, ${y.label} = ${textOf(y, cells.ys[j])}: ${column.label} ${Number.isFinite(column.values[member]) ? textOf(column, column.values[member]) : "undefined"}`;
    };
    const plane = rubato.plane(card.body, { label: `Map over ${x.label} and ${y.label}`, height: 460, right: 86,
      extent: { x: [xEdges[0], xEdges[xEdges.length - 1]], y: [yEdges[0], yEdges[yEdges.length - 1]] }, draw, describe,
      decorate: (ctx, frame) => bar(ctx, frame, column), xLabel: () => x.label, yLabel: () => y.label });
    card.control(rubato.select("colour", options(shown), "0", (value) => { column = shown[Number(value)]; plane.redraw(); }), " ",
      rubato.button("Reset zoom", "Show the whole map", plane.reset));
    card.note(`${thinned(members)} Blank: undefined.`);
    return true;
  };

  /** One column against another, as points. */
  const scatter = (grid, given, all, members) => {
    const card = rubato.card(grid, "Members", { wide: true });
    const choice = { x: all.indexOf(given[0] || all[0]), y: all.findIndex(({ group }) => group !== "given"), c: all.indexOf(given[given.length - 1] || all[0]) };
    if (choice.y < 0) choice.y = 0;
    const extent = () => ({ x: padded(range(all[choice.x].values)), y: padded(range(all[choice.y].values)) });
    const draw = (ctx, frame) => {
      const [xs, ys, colours] = [all[choice.x].values, all[choice.y].values, all[choice.c]];
      const { css } = scale(colours);
      const size = xs.length > 5000 ? 2 : 4;
      xs.forEach((value, m) => {
        const [left, top] = [frame.x(value), frame.y(ys[m])];
        if (!Number.isFinite(left + top)) return;
        ctx.fillStyle = css(colours.values[m]);
        ctx.fillRect(left - size / 2, top - size / 2, size, size);
      });
    };
    const describe = (a, b, frame) => {
      if (a === null) return " ";
      const [xs, ys] = [all[choice.x].values, all[choice.y].values];
      let [nearest, least] = [-1, 400];
      xs.forEach((value, m) => {
        const distance = (frame.x(value) - frame.x(a)) ** 2 + (frame.y(ys[m]) - frame.y(b)) ** 2;
        if (distance < least) [nearest, least] = [m, distance];
      });
      if (nearest < 0) return " ";
      return `member ${count(nearest * members.stride)}: ` + [choice.x, choice.y].map((i) => `${all[i].label} = ${textOf(all[i], all[i].values[nearest])}`).join(", ");
    };
    const plane = rubato.plane(card.body, { label: "Members", height: 360, right: 86, extent: extent(), draw, describe,
      decorate: (ctx, frame) => bar(ctx, frame, all[choice.c]), xLabel: () => all[choice.x].label, yLabel: () => all[choice.y].label });
    const choose = (key) => (value) => {
      choice[key] = Number(value);
      if (key === "c") plane.redraw();
      else plane.extend(extent());
    };
    card.control(rubato.select("across", options(all), `${choice.x}`, choose("x")), " ", rubato.select("up", options(all), `${choice.y}`, choose("y")), " ",
      rubato.select("colour", options(all), `${choice.c}`, choose("c")), " ", rubato.button("Reset zoom", "Show all members", plane.reset));
    card.note(thinned(members));
    const gaps = Array.from(all[choice.y].values).filter((value) => !Number.isFinite(value)).length;
    if (gaps > 0) card.note(rubato.undefinedNote(gaps, all[choice.y].values.length, "members", "not drawn"));
  };

  /** The orbits of all members at the output times, in a plane of two coordinates. */
  const portrait = (grid, data, colourOf) => {
    if (data.paths.length < 3) return;
    const [member, ...columns] = data.paths.map((path) => ({ name: path.name, values: rubato.unpack.array(path.values) }));
    if (member.values.length === 0) return;
    const choice = { x: 0, y: columns.length / 2 };
    const card = rubato.card(grid, "Phase portraits");
    const extent = () => ({ x: padded(range(columns[choice.x].values)), y: padded(range(columns[choice.y].values)) });
    const draw = (ctx, frame) => {
      const [xs, ys] = [columns[choice.x].values, columns[choice.y].values];
      ctx.lineWidth = 1;
      ctx.globalAlpha = data.path_members.shown > 40 ? 0.5 : 0.9;
      for (let begin = 0; begin < xs.length;) {
        let end = begin + 1;
        while (end < xs.length && member.values[end] === member.values[begin]) ++end;
        ctx.strokeStyle = colourOf(member.values[begin]);
        ctx.beginPath();
        for (let i = begin; i < end; ++i) ctx.lineTo(frame.x(xs[i]), frame.y(ys[i]));
        ctx.stroke();
        begin = end;
      }
      ctx.globalAlpha = 1;
    };
    const describe = (a, b) => (a === null ? " " : `${columns[choice.x].name} = ${number(a, 5)}, ${columns[choice.y].name} = ${number(b, 5)}`);
    const plane = rubato.plane(card.body, { label: "Phase portraits", height: 400, extent: extent(), draw, describe,
      xLabel: () => columns[choice.x].name, yLabel: () => columns[choice.y].name });
    const choose = (axis) => (value) => { choice[axis] = Number(value); plane.extend(extent()); };
    const names = columns.map(({ name }, index) => [`${index}`, name]);
    card.control(rubato.select("across", names, "0", choose("x")), " ", rubato.select("up", names, `${choice.y}`, choose("y")), " ",
      rubato.button("Reset zoom", "Show all", plane.reset));
    const { count: all, shown } = data.path_members;
    card.note(`${shown < all ? `Thinned: ${count(shown)} of ${count(all)} members` : `All ${count(all)} members`}, at the output times, joined by straight lines.`);
  };

  return (data) => {
    const { members } = data;
    const columns = unpack(data);
    const given = columns.filter(({ group }) => group === "given");
    const shown = columns.filter((column) => column.group !== "given" && Array.from(column.values).some(Number.isFinite));
    const grid = rubato.section("Members", "members");
    const events = shown.filter(({ name }) => name === "ended_by" || name.startsWith("events/") || name === "stopped/t");
    const ranked = [...events, ...shown.filter((column) => !events.includes(column))];
    const hasMap = given.length === 2 && ranked.length > 0 && map(grid, given[0], given[1], ranked, members);
    scatter(grid, given, [...given, ...(hasMap ? shown : ranked)], members);
    const main = given.find(({ words }) => words.length === 0) || given[0];
    const colours = main ? scale(main) : null;
    const colourOf = (member) => (colours ? colours.css(main.values[Math.round(member / members.stride)]) : rubato.colour.series(0));
    portrait(grid, data, colourOf);
    rubato.sections(data, colourOf);
  };
})();
