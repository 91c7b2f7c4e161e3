"use strict";

/** Maps: blocks of a lattice's values over space and time, or over the plane at one time, as colours. */

/** All maps of a record. */
rubato.unpackMaps = (data) => {
  const unpacked = (maps, times) => {
    const first = rubato.unpack.array(times.first);
    const last = times.last ? rubato.unpack.array(times.last) : first;
    return maps.map((packed) => rubato.unpackMap(packed, first, last));
  };
  return [...unpacked(data.maps, data.map_times), ...(data.quantity_maps ? unpacked(data.quantity_maps, data.quantity_map_times) : [])];
};

/**
 * A map as packed by space_time_map.cpp or film.cpp, with the values of its blocks and its profiles at hand. The colours of
 * a residual end where rounding begins, and span at least four decades: a law met to rounding is dark.
 */
rubato.unpackMap = (packed, first, last) => {
  const own = packed.values ? rubato.unpack.coded(packed.values) : null;
  const profile = packed.profile
    ? { high: rubato.unpack.coded(packed.profile.high), low: packed.profile.low ? rubato.unpack.coded(packed.profile.low) : null }
    : { high: own, low: null };
  const columns = packed.x.parts;
  const rows = packed.shape === "film" ? packed.y.parts : packed.levels.parts;
  const { minimum, maximum } = own || profile.high;
  const signed = !packed.logarithmic && ((minimum < 0 && maximum > 0) || packed.group === "error");
  const limit = Math.max(-minimum, maximum) || 1;
  const rounding = packed.logarithmic && packed.rounding > 0 ? Math.log10(packed.rounding) : null;
  const above = (low, high) => [low, high > low ? high : low + (Math.abs(low) * 0.1 || 1)];
  const range = rounding !== null ? [rounding, Math.max(maximum, rounding + 4)] : (signed ? [-limit, limit] : above(minimum, maximum));
  const { undefinedCode } = rubato.unpack;
  const centre = own && !packed.logarithmic ? own.code(packed.centre) : -1;
  /** Of two codes the one that a picture must not lose: farther from the centre, or larger. */
  const stronger = (a, b) => {
    if (a === undefinedCode || b === undefinedCode) return undefinedCode;
    return Math.abs(a - centre) >= Math.abs(b - centre) ? a : b;
  };
  const index = new Uint8Array(65536);
  if (own) {
    for (let code = 0; code <= rubato.unpack.steps; ++code) {
      index[code] = Math.round(255 * Math.min(1, Math.max(0, (own.value(code) / 2 - range[0] / 2) / (range[1] / 2 - range[0] / 2))));
    }
  }
  /** Edges of the places along time, half way between the levels. */
  const edges = new Float64Array(first.length + 1);
  edges[0] = first[0];
  for (let i = 1; i < first.length; ++i) edges[i] = (last[i - 1] + first[i]) / 2;
  edges[first.length] = last[last.length - 1];
  const backward = edges[first.length] < edges[0];
  const place = (t) => {
    let from = 0;
    let to = first.length - 1;
    while (from < to) {
      const middle = (from + to + 1) >> 1;
      if (backward ? edges[middle] >= t : edges[middle] <= t) from = middle;
      else to = middle - 1;
    }
    return from;
  };
  const axis = (packedAxis) => {
    const spacing = packedAxis.count > 1 ? (packedAxis.last - packedAxis.first) / (packedAxis.count - 1) : 1;
    const begin = (part) => Math.ceil(part * packedAxis.count / packedAxis.parts);
    return {
      name: packedAxis.name,
      extent: [packedAxis.first - spacing / 2, packedAxis.last + spacing / 2],
      part: (x) => {
        const node = Math.round((x - packedAxis.first) / spacing);
        return node < 0 || node >= packedAxis.count ? -1 : Math.floor(node * packedAxis.parts / packedAxis.count);
      },
      /** The middle of a part. */
      centre: (part) => packedAxis.first + spacing * (begin(part) + begin(part + 1) - 1) / 2,
      parts: packedAxis.parts,
    };
  };
  const text = (at) => {
    const value = own.value(own.codes[at]);
    if (Number.isNaN(value)) return "undefined";
    return rubato.format.number(packed.logarithmic ? 10 ** value : value, 5) + (rounding !== null && value <= rounding ? " (rounding)" : "");
  };
  return { packed, profile, rows, columns, range, rounding, shown: own ? own.codes : null, stronger, index, first, edges, place, text,
    times: first.length, x: axis(packed.x), y: packed.y ? axis(packed.y) : null,
    colours: () => (signed ? rubato.colour.diverging() : rubato.colour.sequential()) };
};

/** Draws a map, or frame number `frame` of a film, into the frame of a plane. */
rubato.drawMap = (ctx, frame, map, rowPart, frameNumber = 0) => {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(frame.width * ratio));
  const height = Math.max(1, Math.round(frame.height * ratio));
  const image = new ImageData(width, height);
  const colours = map.colours();
  const offset = frameNumber * map.rows * map.columns;
  const places = (count, at, part) => Array.from({ length: count }, (_, i) => {
    const [a, b] = [part(at(i)), part(at(i + 0.999))];
    return [Math.min(a, b), Math.max(a, b)];
  });
  const columns = places(width, (i) => frame.atX(frame.left + i / ratio), map.x.part);
  const rows = places(height, (i) => frame.atY(frame.top + i / ratio), rowPart);
  const line = new Uint16Array(map.columns);
  let previous = null;
  for (let j = 0; j < height; ++j) {
    const [row0, row1] = rows[j];
    if (row1 < 0) continue;
    if (!previous || previous[0] !== row0 || previous[1] !== row1) {
      line.set(map.shown.subarray(offset + row1 * map.columns, offset + (row1 + 1) * map.columns));
      for (let row = Math.max(row0, 0); row < row1; ++row) {
        for (let column = 0; column < map.columns; ++column) {
          line[column] = map.stronger(line[column], map.shown[offset + row * map.columns + column]);
        }
      }
      previous = rows[j];
    }
    for (let i = 0; i < width; ++i) {
      const [column0, column1] = columns[i];
      if (column1 < 0) continue;
      let code = line[column1];
      for (let column = Math.max(column0, 0); column < column1; ++column) code = map.stronger(code, line[column]);
      const colour = code === rubato.unpack.undefinedCode ? rubato.colour.undefinedAt(i, j) : colours[map.index[code]];
      const at = 4 * (j * width + i);
      image.data[at] = colour[0];
      image.data[at + 1] = colour[1];
      image.data[at + 2] = colour[2];
      image.data[at + 3] = 255;
    }
  }
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d").putImageData(image, 0, 0);
  ctx.drawImage(canvas, frame.left, frame.top, frame.width, frame.height);
};

/** The colour bar to the right of a plane. */
rubato.drawColourBar = (ctx, frame, map) => {
  const left = frame.left + frame.width + 12;
  const colours = map.colours();
  for (let i = 0; i < 256; ++i) {
    ctx.fillStyle = rubato.colour.css(colours[255 - i]);
    ctx.fillRect(left, frame.top + frame.height * i / 256, 12, frame.height / 256 + 1);
  }
  ctx.strokeStyle = rubato.theme.colour("line");
  ctx.strokeRect(left + 0.5, frame.top + 0.5, 12, frame.height - 1);
  if (map.rounding !== null) {
    const bottom = frame.top + frame.height;
    ctx.fillStyle = rubato.theme.colour("faint");
    ctx.font = rubato.theme.font(11);
    ctx.textAlign = "left";
    ctx.textBaseline = "top";
    ctx.fillText("rounding", left, bottom + 5);
    ctx.fillText(`\u2264 ${rubato.format.number(10 ** map.rounding, 2)}`, left, bottom + 19);
    ctx.fillRect(left, bottom - 2, 16, 2);
  }
  const [low, high] = map.range;
  const y = (value) => frame.top + frame.height * (high - value) / (high - low);
  ctx.fillStyle = rubato.theme.colour("faint");
  ctx.font = rubato.theme.font(11.5);
  ctx.textAlign = "left";
  ctx.textBaseline = "middle";
  let values = rubato.format.ticks(low, high, Math.max(2, frame.height / 45));
  if (map.packed.logarithmic) values = values.filter((value) => Math.abs(value - Math.round(value)) < 1e-9);
  const texts = map.packed.logarithmic ? values.map((value) => rubato.format.power(Math.round(value))) : rubato.format.tickTexts(values);
  texts.forEach((text, i) => {
    ctx.fillRect(left + 12, y(values[i]), 4, 1);
    ctx.fillText(text, left + 19, y(values[i]));
  });
};

/** A map with its axes, colour bar and time cursor, linked to the clock. */
rubato.mapPlane = (host, map, label) => {
  const isFilm = map.packed.shape === "film";
  let shownFrame = -1;
  const plane = rubato.plane(host, {
    label, right: 86,
    height: isFilm ? undefined : 330,
    ratio: isFilm ? Math.min(1.1, (map.y.extent[1] - map.y.extent[0]) / (map.x.extent[1] - map.x.extent[0])) : undefined,
    xLabel: () => map.x.name,
    yLabel: () => (isFilm ? map.y.name : "t"),
    extent: { x: map.x.extent, y: isFilm ? map.y.extent : [map.edges[0], map.edges[map.times]].sort((a, b) => a - b) },
    draw: (ctx, frame) => {
      shownFrame = map.place(rubato.clock.get());
      rubato.drawMap(ctx, frame, map, isFilm ? map.y.part : map.place, isFilm ? shownFrame : 0);
    },
    decorate: (ctx, frame) => rubato.drawColourBar(ctx, frame, map),
    mark: (ctx, frame) => {
      if (isFilm) return;
      const y = frame.y(rubato.clock.get());
      ctx.lineWidth = 3;
      ctx.strokeStyle = rubato.theme.colour("card");
      ctx.beginPath();
      ctx.moveTo(frame.left, y);
      ctx.lineTo(frame.left + frame.width, y);
      ctx.stroke();
      ctx.lineWidth = 1.5;
      ctx.strokeStyle = rubato.theme.colour("accent");
      ctx.stroke();
      ctx.lineWidth = 1;
    },
    describe: (x, y) => {
      const now = map.place(rubato.clock.get());
      if (x === null) return isFilm ? `t = ${rubato.format.number(map.first[now])}` : " ";
      const column = map.x.part(x);
      const row = isFilm ? map.y.part(y) : map.place(y);
      if (column < 0 || row < 0) return " ";
      const at = (isFilm ? now * map.rows * map.columns : 0) + row * map.columns + column;
      const t = isFilm ? map.first[now] : y;
      return `${map.x.name} = ${rubato.format.number(x, 5)}, ${isFilm ? `${map.y.name} = ${rubato.format.number(y, 5)}, ` : ""}` +
        `t = ${rubato.format.number(t, 5)}: ${map.packed.name} ${map.packed.logarithmic ? "residual " : ""}${map.text(at)}`;
    },
    choose: (x, y) => { if (!isFilm) rubato.clock.set(y); },
    step: (dx, dy) => {
      const next = Math.min(map.times - 1, Math.max(0, map.place(rubato.clock.get()) + (dy || dx)));
      rubato.clock.set(map.first[next]);
    },
  });
  rubato.clock.watch((t) => {
    if (isFilm && map.place(t) !== shownFrame) plane.redraw();
    else plane.remark();
  });
  return plane;
};
