"use strict";

/** Words and tables: the head of the page, the laws, the problem, where the record comes from. */
rubato.tables = (() => {
  const el = (...args) => rubato.element(...args);

  const head = (title, lede, facts) => {
    const list = el("dl", { class: "facts" });
    facts.forEach(([label, value, remark]) => list.append(el("div", { class: "fact" }, el("dt", {}, label), el("dd", { title: value }, value),
      remark ? el("dd", {}, remark) : null)));
    document.getElementById("report").append(
      el("header", {}, el("div", {}, el("h1", {}, title), el("p", { class: "lede" }, lede)),
        rubato.button("Light / dark", "Switch between the light and the dark scheme", rubato.theme.toggle)), list);
  };

  const table = (head, rows) => el("div", { class: "table" }, el("table", { class: "laws" },
    el("thead", {}, el("tr", {}, ...head.map((text) => el("th", { scope: "col" }, text)))),
    el("tbody", {}, ...rows.map(([first, ...rest]) => el("tr", {}, el("th", { scope: "row" }, first), ...rest.map((text) => el("td", {}, text)))))));

  const laws = (head, rows, title = "How well each law held") => {
    const card = rubato.card(rubato.section("Laws and figures", "laws"), title, { wide: true });
    card.body.append(table(head, rows));
  };

  const origin = (records) => {
    const grid = rubato.section("Problem and provenance", "problem");
    records.forEach((one) => {
      const { provenance } = one;
      const rows = [["Record", provenance.record], ["Format", provenance.format], ["Written by", `Rubato ${provenance.version}`],
        ["Built with", provenance.compiler], ["Threads", String(provenance.threads)], ["Reached its end", provenance.finished ? "yes" : "no"]];
      const problem = rubato.card(grid, `Problem file of ${provenance.record}`);
      problem.body.append(el("pre", { tabindex: "0", "aria-label": "Problem file" }, one.problem));
      problem.note("The effective problem, with every --set in it: saved as a file, it can be run again.");
      const source = rubato.card(grid, "Where the record comes from");
      source.body.append(table(["", ""], rows));
    });
  };

  const foot = () => document.getElementById("report").append(el("footer", {},
    "Drag across a picture to zoom, double click to see all. All curves over time share zoom and cursor. " +
    "Click into a space\u2013time map, or use the slider, to choose a time. Colours of maps are equally spaced in OKLab."));

  return { head, laws, origin, foot };
})();
