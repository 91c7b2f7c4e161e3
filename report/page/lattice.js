"use strict";

/** The page of a lattice. */
rubato.lattice = (data) => {
  const maps = data.maps.map(rubato.unpackMap);
  const group = (name) => maps.filter((map) => map.packed.group === name);
  const remark = ({ packed }) => {
    const shown = packed.logarithmic ? "its largest value" : `its value farthest from ${packed.centre === 0 ? "zero" : `the mean, ${rubato.format.number(packed.centre, 4)}`}`;
    const parts = [];
    if (packed.slice) parts.push(`The slice ${packed.slice.axis} = ${rubato.format.number(packed.slice.at)}.`);
    if (packed.shape === "film" && packed.levels.parts < packed.levels.count) {
      parts.push(`${packed.levels.parts} of ${packed.levels.count} stored levels; the extremes below are of all of them.`);
    }
    if (packed.shape === "film" && packed.thinned) {
      parts.push(`Thinned: ${packed.x.count} \u00d7 ${packed.y.count} nodes in ${packed.x.parts} \u00d7 ${packed.y.parts} blocks, each of which shows ${shown}.`);
    }
    if (packed.shape !== "film" && packed.thinned) {
      parts.push(`Thinned: ${packed.levels.count} levels \u00d7 ${packed.x.count} cells in ${packed.levels.parts} \u00d7 ${packed.x.parts} blocks, each of which shows ${shown}.` +
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
      rubato.curve(card.body, { label: `${title}: extremes over the whole grid`, yLabel: "extremes", height: 150, right: 86,
        logarithmic: map.packed.logarithmic,
        series: [{ label: "largest", x: t, y: rubato.unpack.array(extremes.high) }, { label: "smallest", x: t, y: rubato.unpack.array(extremes.low), colour: 1 }]
          .slice(0, map.packed.logarithmic ? 1 : 2) });
    } else if (map.packed.group === "field" || (map.packed.group === "error" && !map.packed.thinned)) {
      const entries = [{ map, label: map.packed.name, colour: 0 }];
      rubato.profile(card.body, map.packed.name, exact ? [...entries, { map: exact, label: "exact", colour: 1, dash: [6, 4] }] : entries);
    }
    const text = remark(map);
    if (text) card.note(text);
  };
  const fields = rubato.section("Fields", "fields");
  group("field").forEach((map) => show(fields, map, `Field ${map.packed.name}`, group("exact").find((one) => one.packed.name === map.packed.name)));
  group("error").forEach((map) => show(fields, map, `Error in ${map.packed.name}`));
  if (group("residual").length > 0) {
    const residuals = rubato.section("Local laws, cell by cell", "maps");
    group("residual").forEach((map) => show(residuals, map, `Residual of ${map.packed.name}, magnitude`));
  }
  rubato.commonCurves.all(data);
  const times = maps[0].first;
  rubato.player(times, times[times.length - 1]);
};
