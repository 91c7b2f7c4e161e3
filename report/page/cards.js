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

/** Says honestly that a picture has fewer points than the record. */
rubato.thinningNote = (count, shown, what) => (count > shown
  ? `Thinned: of ${count.toLocaleString("en")} ${what} the smallest and the largest of each run of about ` +
    `${Math.max(2, Math.round(2 * count / shown)).toLocaleString("en")} are drawn.`
  : null);
