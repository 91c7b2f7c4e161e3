"use strict";

/** Everything of the page's own lives in this object; each script adds its part. */
const rubato = {};

/** A value that others may watch. */
rubato.signal = (initial) => {
  let value = initial;
  const watchers = [];
  return {
    get: () => value,
    set: (next) => {
      value = next;
      watchers.forEach((watch) => watch(value));
    },
    watch: (watcher) => watchers.push(watcher),
  };
};

/** The time that the player, the cursors of maps and the marks on curves share. */
rubato.clock = rubato.signal(0);

/** Everything drawn so far: the curves, and the planes of maps and portraits. */
rubato.pictures = { curves: [], planes: [] };

/** Light or dark: as the reader's system says, until the button says otherwise. */
rubato.theme = (() => {
  const root = document.documentElement;
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  const scheme = rubato.signal(system.matches ? "dark" : "light");
  let chosen = false;
  scheme.watch((name) => { root.dataset.theme = name; });
  scheme.set(scheme.get());
  system.addEventListener("change", () => {
    if (!chosen) scheme.set(system.matches ? "dark" : "light");
  });
  return {
    isDark: () => scheme.get() === "dark",
    watch: scheme.watch,
    toggle: () => {
      chosen = true;
      scheme.set(scheme.get() === "dark" ? "light" : "dark");
    },
    /** A colour of the style sheet, by the name of its variable. */
    colour: (name) => getComputedStyle(root).getPropertyValue("--" + name).trim(),
    font: (size) => `${size}px ${getComputedStyle(document.body).fontFamily}`,
  };
})();
