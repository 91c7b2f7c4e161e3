"use strict";

/** The page of a lattice. */
rubato.lattice = (data) => {
  const maps = rubato.unpackMaps(data);
  const group = (name) => maps.filter((map) => map.packed.group === name);
  const remark = ({ packed }) => {
    const shown = packed.logarithmic ? "its largest value" : `its value farthest from ${packed.centre === 0 ? "zero" : `the mean, ${rubato.format.number(packed.centre, 4)}`}`;
    const parts = [];
    const { count, percent } = rubato.format;
    if (packed.rounding > 0) {
      parts.push(`Colours end at ${rubato.format.number(packed.rounding, 2)}: up to there it is what rounding alone leaves (\u03b5 times the terms of the law).`);
    }
    if (packed.undefined > 0) {
      parts.push(rubato.undefinedNote(packed.undefined, packed.count, "values", packed.shape === "film" ? "striped in the pictures" : "striped"));
    }
    if (packed.has_gaps) parts.push("The laws were not taken at every level: between there is nothing to be seen.");
    else if (packed.starts_late) parts.push("There is no value before the first step.");
    if (packed.slice) parts.push(`The slice ${packed.slice.axis} = ${rubato.format.number(packed.slice.at)}.`);
    if (packed.shape === "film" && packed.levels.parts < packed.levels.count) {
      parts.push(`${count(packed.levels.parts)} of ${count(packed.levels.count)} ${packed.group === "quantity" ? "output times" : "stored levels"}, ${percent(packed.levels.count - packed.levels.parts, packed.levels.count)} are left out; the extremes below are of all of them.`);
    }
    if (packed.shape === "film" && packed.thinned) {
      parts.push(`Thinned: ${packed.x.count} \u00d7 ${packed.y.count} nodes in ${packed.x.parts} \u00d7 ${packed.y.parts} blocks, each of which shows ${shown}, or that one is undefined; ` +
        `${percent(packed.x.count * packed.y.count - packed.x.parts * packed.y.parts, packed.x.count * packed.y.count)} are left out.` +
        (packed.group === "field" ? ` rubato report --field ${packed.name} draws this field in full where the page has room.` : ""));
    }
    if (packed.shape !== "film" && packed.thinned) {
      parts.push(`Thinned: ${count(packed.levels.count)} levels \u00d7 ${count(packed.x.count)} cells in ${count(packed.levels.parts)} \u00d7 ${count(packed.x.parts)} blocks, each of which shows ${shown}, or that one is undefined; ` +
        `${percent(packed.levels.count * packed.x.count - packed.levels.parts * packed.x.parts, packed.levels.count * packed.x.count)} are left out.` +
        (packed.profile ? " Profiles are of the first level in each row of blocks." : ""));
    }
    return parts.join(" ");
  };
  const show = (grid, map, title, exact) => {
    const card = rubato.card(grid, title);
    const plane = rubato.mapPlane(card.body, map, title);
    card.control(rubato.button("Reset zoom", "Show the whole map", plane.reset));
    if (map.packed.shape === "film") {
      const { extremes } = map.packed;
      const t = rubato.unpack.array(extremes.t);
      const offLaw = rubato.commonCurves.offLaw(data);
      rubato.curve(card.body, { label: `${title}: extremes over the whole grid`, yLabel: "extremes", height: 150, right: 86, offLaw,
        rounding: map.packed.logarithmic ? map.packed.rounding : 0,
        logarithmic: map.packed.logarithmic,
        series: [{ label: "largest", x: t, y: rubato.unpack.array(extremes.high) }, { label: "smallest", x: t, y: rubato.unpack.array(extremes.low), colour: 1 }]
          .slice(0, map.packed.logarithmic ? 1 : 2) });
    } else if (map.packed.group === "field" || map.packed.group === "quantity" || (map.packed.group === "error" && !map.packed.thinned)) {
      const entries = [{ map, label: map.packed.name, colour: 0 }];
      rubato.profile(card.body, map.packed.name, exact ? [...entries, { map: exact, label: "exact", colour: 1, dash: [6, 4] }] : entries);
    }
    const text = remark(map);
    if (text) card.note(text);
    if (map.packed.extremes) {
      const thinned = rubato.thinningNote(map.packed.extremes.count, rubato.unpack.array(map.packed.extremes.t).length, "extremes");
      if (thinned) card.note(thinned);
    }
  };
  const fields = rubato.section("Fields", "fields");
  group("field").forEach((map) => show(fields, map, `Field ${map.packed.name}`, group("exact").find((one) => one.packed.name === map.packed.name)));
  group("error").forEach((map) => show(fields, map, `Error in ${map.packed.name}`));
  if (group("quantity").length > 0) {
    const quantities = rubato.section("Quantities at nodes", "quantities");
    group("quantity").forEach((map) => show(quantities, map, `Quantity ${map.packed.name}`));
  }
  if (group("residual").length > 0) {
    const residuals = rubato.section("Local laws, cell by cell", "maps");
    group("residual").forEach((map) => show(residuals, map, `Residual of ${map.packed.name}, magnitude`));
  }
  rubato.sections(data);
  rubato.commonCurves.all(data);
  const times = maps[0].first;
  rubato.player(times, times[times.length - 1]);
};
