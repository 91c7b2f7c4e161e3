"use strict";

/** Poincare sections: the quantities of events as points in a plane of two of them; of an ensemble colourOf(member) is the colour. */
rubato.sections = (data, colourOf = null) => {
  const sections = (data.sections || []).filter(({ columns }) => columns.length > 1);
  if (sections.length === 0) return;
  const grid = rubato.section("Sections", "sections");
  sections.forEach((section) => {
    const columns = section.columns.map((column) => ({ name: column.name, values: rubato.unpack.array(column.values) }));
    const title = section.name === "section" ? "Section" : `Section ${section.name}`;
    const card = rubato.card(grid, title, { wide: false });
    const choice = { x: 0, y: 1 };
    const { count, number } = rubato.format;
    const span = (values) => {
      const finite = Array.from(values).filter(Number.isFinite);
      if (finite.length === 0) return [0, 1];
      const [low, high] = finite.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
      const pad = ((high - low) / 2 || Math.abs(high) / 2 || 0.5) * 0.1;
      return [low - pad, high + pad];
    };
    const extent = () => ({ x: span(columns[choice.x].values), y: span(columns[choice.y].values) });
    const draw = (ctx, frame) => {
      const [xs, ys] = [columns[choice.x].values, columns[choice.y].values];
      const size = xs.length > 20000 ? 1 : xs.length > 2000 ? 1.5 : 2.5;
      ctx.fillStyle = rubato.colour.series(0);
      const members = colourOf && section.member ? rubato.unpack.array(section.member) : null;
      for (let i = 0; i < xs.length; ++i) {
        const [left, top] = [frame.x(xs[i]), frame.y(ys[i])];
        if (members) ctx.fillStyle = colourOf(members[i]);
        if (Number.isFinite(left + top)) ctx.fillRect(left - size / 2, top - size / 2, size, size);
      }
    };
    const describe = (x, y) => (x === null ? " " : `${columns[choice.x].name} = ${number(x, 5)}, ${columns[choice.y].name} = ${number(y, 5)}`);
    const plane = rubato.plane(card.body, { label: title, height: 400, extent: extent(), draw, describe,
      xLabel: () => columns[choice.x].name, yLabel: () => columns[choice.y].name });
    const choose = (axis) => (value) => {
      choice[axis] = Number(value);
      plane.extend(extent());
    };
    if (columns.length > 2) {
      const names = columns.map(({ name }, index) => [`${index}`, name]);
      card.control(rubato.select("across", names, "0", choose("x")), " ", rubato.select("up", names, "1", choose("y")), " ");
    }
    card.control(rubato.button("Reset zoom", "Show the whole section", plane.reset));
    const shown = columns[0].values.length;
    card.note(section.count === 0 ? "There are no crossings."
      : shown === section.count ? `All ${count(shown)} crossings.` : `Thinned: every ${Math.ceil(section.count / shown)}th of ${count(section.count)} crossings.`);
    const undefinedOnes = Array.from(columns[choice.x].values).filter((value, i) => !Number.isFinite(value + columns[choice.y].values[i])).length;
    if (undefinedOnes > 0) card.note(rubato.undefinedNote(undefinedOnes, shown, "points"));
  });
};
