"use strict";

/** Elements of the page. */

/** element("p", { class: "note" }, "text", …): children are elements or text, which is never read as HTML. */
rubato.element = (name, attributes = {}, ...children) => {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(key, value);
    else if (value !== null && value !== undefined) element.setAttribute(key, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
};

rubato.section = (title, id) => {
  const grid = rubato.element("div", { class: "cards" });
  const section = rubato.element("section", { "aria-label": title, id: id }, rubato.element("h2", {}, title), grid);
  document.getElementById("report").append(section);
  return grid;
};

/** A card with a title and controls; what it shows is put into it later. */
rubato.card = (grid, title, { wide = false } = {}) => {
  const controls = rubato.element("span");
  const head = rubato.element("div", { class: "head" }, rubato.element("h3", {}, title), controls);
  const card = rubato.element("figure", { class: wide ? "card wide" : "card", "aria-label": title }, head);
  grid.append(card);
  return {
    body: card,
    control: (...elements) => controls.append(...elements),
    note: (text) => card.append(rubato.element("figcaption", { class: "note" }, text)),
  };
};

rubato.button = (text, label, action) => rubato.element("button", { type: "button", "aria-label": label, title: label, click: action }, text);

rubato.select = (label, options, chosen, action) => {
  const select = rubato.element("select", { change: (event) => action(event.target.value) });
  options.forEach(([value, text]) => {
    const option = rubato.element("option", { value: value }, text);
    option.selected = value === chosen;
    select.append(option);
  });
  return rubato.element("label", {}, rubato.element("span", {}, label), select);
};

/**
 * A menu of boxes to tick: rubato.choose(label, [[value, text], …], chosen, action), where action is given the values that
 * are ticked, in the order of the menu.
 */
rubato.choose = (label, options, chosen, action) => {
  const boxes = options.map(([value, text]) => {
    const box = rubato.element("input", { type: "checkbox", value: value, change: () => action(boxes.filter(({ box: one }) => one.checked).map((one) => one.value)) });
    box.checked = chosen.includes(value);
    return { value, box, row: rubato.element("label", {}, box, rubato.element("span", {}, text)) };
  });
  const menu = rubato.element("details", { class: "choose" }, rubato.element("summary", {}, label),
    rubato.element("div", { role: "group", "aria-label": label }, ...boxes.map(({ row }) => row)));
  document.addEventListener("pointerdown", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("keydown", (event) => { if (event.key === "Escape") menu.open = false; });
  return menu;
};

/** Names with their colours, each a button that shows or hides: rubato.legend(host, [[name, colour()], …], toggle(index, isShown)). */
rubato.legend = (host, entries, toggle) => {
  const list = rubato.element("div", { class: "legend", role: "group", "aria-label": "Legend: what is drawn" });
  entries.forEach(([name, colour], index) => {
    const swatch = rubato.element("span", { class: "swatch" });
    const paint = () => { swatch.style.background = colour(); };
    const button = rubato.element("button", { type: "button", "aria-pressed": "true", title: `Show or hide ${name}`, click: () => {
      const isShown = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(isShown));
      toggle(index, isShown);
    } }, swatch, name);
    paint();
    rubato.theme.watch(paint);
    list.append(button);
  });
  host.append(list);
};

/** Says honestly that a picture has fewer points than the record. */
rubato.thinningNote = (count, shown, what) => {
  const { count: text, percent } = rubato.format;
  return count > shown
    ? `Thinned: ${text(shown)} of ${text(count)} ${what} are drawn, the smallest and the largest of each run of about ` +
      `${text(Math.max(2, Math.round(2 * count / shown)))}; ${percent(count - shown, count)} are left out.`
    : null;
};

/** Says that some values are none. */
rubato.undefinedNote = (undefinedCount, count, what = "values", shown = "gaps in the curve") => (undefinedCount > 0
  ? `Undefined: ${rubato.format.count(undefinedCount)} of ${rubato.format.count(count)} ${what} (${shown}).`
  : null);
