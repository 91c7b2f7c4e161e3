"use strict";

/** The bar that moves the clock: play, step, a slider over the levels shown, and speed. The clock starts at `start`. */
rubato.player = (times, start = times[0]) => {
  const count = times.length;
  const [first, last] = [times[0], times[count - 1]];
  const sign = Math.sign(last - first) || 1;
  const nearest = (t) => {
    let [from, to] = [0, count - 1];
    while (to - from > 1) {
      const middle = (from + to) >> 1;
      if ((times[middle] - t) * sign <= 0) from = middle;
      else to = middle;
    }
    return Math.abs(times[from] - t) <= Math.abs(times[to] - t) ? from : to;
  };
  const slider = rubato.element("input", { type: "range", min: "0", max: String(count - 1), step: "1", value: "0", "aria-label": "Time" });
  const output = rubato.element("output", { "aria-live": "off" });
  let seconds = 10;
  let playing = false;
  let before = 0;

  const tick = (now) => {
    if (!playing) return;
    const next = rubato.clock.get() + (last - first) * (now - before) / 1000 / seconds;
    before = now;
    rubato.clock.set((next - last) * Math.sign(last - first) >= 0 ? first : next);
    requestAnimationFrame(tick);
  };
  const play = rubato.button("\u25b6 Play", "Play or pause the animation", () => {
    playing = !playing;
    play.textContent = playing ? "\u23f8 Pause" : "\u25b6 Play";
    play.setAttribute("aria-pressed", String(playing));
    before = performance.now();
    if (playing) requestAnimationFrame(tick);
  });
  play.classList.add("primary");
  const step = (by) => rubato.clock.set(times[Math.min(count - 1, Math.max(0, nearest(rubato.clock.get()) + by))]);
  slider.addEventListener("input", () => rubato.clock.set(times[Number(slider.value)]));
  rubato.clock.watch((t) => {
    slider.value = String(nearest(t));
    slider.setAttribute("aria-valuetext", `t = ${rubato.format.number(t, 5)}`);
    output.textContent = `t = ${rubato.format.number(t, 5)}`;
  });
  const speeds = [["40", "\u00bc\u00d7"], ["20", "\u00bd\u00d7"], ["10", "1\u00d7"], ["5", "2\u00d7"], ["2.5", "4\u00d7"]];
  document.body.append(rubato.element("div", { class: "player", role: "group", "aria-label": "Animation" }, play,
    rubato.button("\u2039", "One level back", () => step(-1)), rubato.button("\u203a", "One level on", () => step(1)),
    slider, output, rubato.select("speed", speeds, "10", (value) => { seconds = Number(value); })));
  rubato.clock.set(start);
};
