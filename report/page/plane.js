"use strict";

/**
 * A picture with two axes on a canvas: ticks, names, zoom by dragging, a value under the pointer, and keys. What is in
 * it is drawn by others. rubato.plane(host, options) with
 *   label, xLabel, yLabel, height (or ratio: height over width), right: space for a colour bar
 *   extent        { x: [low, high], y: [low, high] }, all that can be seen
 *   equal         one unit is equally long on both axes
 *   draw(ctx, frame)   draws what stays; frame has left, top, width, height, x(value), y(value), atX(pixel), atY(pixel)
 *   mark(ctx, frame)   draws what moves, on a layer above
 *   describe(x, y)     the text for the values at a place
 *   choose(x, y)       what a click does
 *   step(dx, dy)       what arrow keys do
 * answers { redraw(), remark(), reset(), extend(extent) }.
 */
rubato.plane = (() => {
  const margin = { left: 82, top: 10, bottom: 42 };

  return (host, options) => {
    const right = options.right || 14;
    const base = rubato.element("canvas");
    const over = rubato.element("canvas");
    const holder = rubato.element("div", { class: "plane", tabindex: "0", role: "img",
      "aria-label": `${options.label}. Drag to zoom, double click or 0 to see all, arrow keys move the cursor.` }, base, over);
    const readout = rubato.element("div", { class: "readout", "aria-live": "off" });
    host.append(holder, readout);
    let full = options.extent;
    let extent = full;
    let size = { width: 0, height: 0 };
    let pointer = null;
    let drag = null;

    /** Where the axes are, in CSS pixels. */
    const frameOf = () => {
      const frame = { left: margin.left, top: margin.top, width: size.width - margin.left - right, height: size.height - margin.top - margin.bottom };
      let [x0, x1] = extent.x;
      let [y0, y1] = extent.y;
      if (options.equal && options.equal()) {
        const unit = Math.max((x1 - x0) / frame.width, (y1 - y0) / frame.height);
        const widen = (low, high, pixels) => [(low + high - unit * pixels) / 2, (low + high + unit * pixels) / 2];
        [x0, x1] = widen(x0, x1, frame.width);
        [y0, y1] = widen(y0, y1, frame.height);
      }
      Object.assign(frame, { x0, x1, y0, y1,
        x: (value) => frame.left + (value - x0) / (x1 - x0) * frame.width,
        y: (value) => frame.top + (y1 - value) / (y1 - y0) * frame.height,
        atX: (pixel) => x0 + (pixel - frame.left) / frame.width * (x1 - x0),
        atY: (pixel) => y1 - (pixel - frame.top) / frame.height * (y1 - y0),
        has: (x, y) => x >= frame.left && x <= frame.left + frame.width && y >= frame.top && y <= frame.top + frame.height });
      return frame;
    };

    const prepare = (canvas) => {
      const ratio = window.devicePixelRatio || 1;
      canvas.width = Math.round(size.width * ratio);
      canvas.height = Math.round(size.height * ratio);
      const ctx = canvas.getContext("2d");
      ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
      ctx.clearRect(0, 0, size.width, size.height);
      return ctx;
    };
    const clipped = (ctx, frame, draw) => {
      ctx.save();
      ctx.beginPath();
      ctx.rect(frame.left, frame.top, frame.width, frame.height);
      ctx.clip();
      draw(ctx, frame);
      ctx.restore();
    };

    const drawAxes = (ctx, frame) => {
      ctx.font = rubato.theme.font(12);
      ctx.fillStyle = rubato.theme.colour("faint");
      ctx.strokeStyle = rubato.theme.colour("line");
      ctx.lineWidth = 1;
      ctx.strokeRect(frame.left + 0.5, frame.top + 0.5, frame.width - 1, frame.height - 1);
      const bottom = frame.top + frame.height;
      const xs = rubato.format.ticks(frame.x0, frame.x1, Math.max(2, frame.width / 80));
      const ys = rubato.format.ticks(frame.y0, frame.y1, Math.max(2, frame.height / 50));
      ctx.textAlign = "center";
      ctx.textBaseline = "top";
      rubato.format.tickTexts(xs).forEach((text, i) => {
        ctx.fillRect(frame.x(xs[i]), bottom, 1, 4);
        ctx.fillText(text, frame.x(xs[i]), bottom + 6);
      });
      ctx.font = rubato.theme.font(12.5);
      ctx.fillText(options.xLabel(), frame.left + frame.width / 2, bottom + 24);
      ctx.font = rubato.theme.font(12);
      ctx.textAlign = "right";
      ctx.textBaseline = "middle";
      rubato.format.tickTexts(ys).forEach((text, i) => {
        ctx.fillRect(frame.left - 4, frame.y(ys[i]), 4, 1);
        ctx.fillText(text, frame.left - 7, frame.y(ys[i]));
      });
      ctx.font = rubato.theme.font(12.5);
      ctx.textAlign = "center";
      ctx.save();
      ctx.translate(11, frame.top + frame.height / 2);
      ctx.rotate(-Math.PI / 2);
      ctx.fillText(options.yLabel(), 0, 0);
      ctx.restore();
    };

    const redraw = () => {
      if (size.width < 120) return;
      const frame = frameOf();
      const ctx = prepare(base);
      clipped(ctx, frame, options.draw);
      drawAxes(ctx, frame);
      if (options.decorate) options.decorate(ctx, frame);
      remark();
    };

    function remark() {
      if (size.width < 120) return;
      const frame = frameOf();
      const ctx = prepare(over);
      clipped(ctx, frame, () => {
        if (options.mark) options.mark(ctx, frame);
        if (drag && drag.moved) {
          ctx.fillStyle = rubato.theme.colour("accent");
          ctx.globalAlpha = 0.2;
          ctx.fillRect(drag.x, drag.y, pointer.x - drag.x, pointer.y - drag.y);
        } else if (pointer) {
          ctx.strokeStyle = rubato.theme.colour("faint");
          ctx.setLineDash([3, 3]);
          ctx.beginPath();
          ctx.moveTo(pointer.x, frame.top);
          ctx.lineTo(pointer.x, frame.top + frame.height);
          ctx.moveTo(frame.left, pointer.y);
          ctx.lineTo(frame.left + frame.width, pointer.y);
          ctx.stroke();
        }
      });
      const inside = pointer && frame.has(pointer.x, pointer.y);
      readout.textContent = inside ? options.describe(frame.atX(pointer.x), frame.atY(pointer.y), frame) : options.describe(null, null, frame);
    }

    const place = (event) => {
      const box = over.getBoundingClientRect();
      return { x: event.clientX - box.left, y: event.clientY - box.top };
    };
    const reset = () => {
      extent = full;
      redraw();
    };
    const zoomTo = (frame, from, to) => {
      const x = [frame.atX(from.x), frame.atX(to.x)].sort((a, b) => a - b);
      const y = [frame.atY(from.y), frame.atY(to.y)].sort((a, b) => a - b);
      extent = { x, y };
      redraw();
    };
    over.addEventListener("pointerdown", (event) => {
      const at = place(event);
      if (event.button !== 0 || !frameOf().has(at.x, at.y)) return;
      over.setPointerCapture(event.pointerId);
      drag = { ...at, moved: false };
      pointer = at;
    });
    over.addEventListener("pointermove", (event) => {
      pointer = place(event);
      if (drag && Math.hypot(pointer.x - drag.x, pointer.y - drag.y) > 6) drag.moved = true;
      remark();
    });
    over.addEventListener("pointerup", (event) => {
      if (!drag) return;
      const frame = frameOf();
      const from = drag;
      drag = null;
      pointer = place(event);
      if (!from.moved) {
        if (options.choose) options.choose(frame.atX(pointer.x), frame.atY(pointer.y));
      } else if (Math.abs(pointer.x - from.x) > 6 && Math.abs(pointer.y - from.y) > 6) {
        zoomTo(frame, from, pointer);
      }
      remark();
    });
    over.addEventListener("pointerleave", () => {
      pointer = null;
      remark();
    });
    over.addEventListener("dblclick", reset);
    const zoomBy = (factor) => {
      const around = (low, high) => [(low + high) / 2 - (high - low) * factor / 2, (low + high) / 2 + (high - low) * factor / 2];
      extent = { x: around(...extent.x), y: around(...extent.y) };
      redraw();
    };
    holder.addEventListener("keydown", (event) => {
      const step = options.step || (() => {});
      const actions = { "0": reset, Escape: reset, "+": () => zoomBy(0.5), "-": () => zoomBy(2), ArrowLeft: () => step(-1, 0),
        ArrowRight: () => step(1, 0), ArrowUp: () => step(0, 1), ArrowDown: () => step(0, -1) };
      if (!actions[event.key]) return;
      event.preventDefault();
      actions[event.key]();
    });

    const resize = () => {
      const width = holder.clientWidth;
      if (width === 0) return;
      const height = options.ratio ? Math.round((width - margin.left - right) * options.ratio) + margin.top + margin.bottom : options.height;
      if (width === size.width && height === size.height) return;
      size = { width, height };
      holder.style.height = `${height}px`;
      redraw();
    };
    new ResizeObserver(resize).observe(holder);
    resize();
    rubato.theme.watch(redraw);
    const plane = {
      redraw, remark, reset,
      frame: frameOf,
      extent: () => extent,
      extend: (next) => {
        full = next;
        reset();
      },
    };
    rubato.pictures.planes.push(plane);
    return plane;
  };
})();
