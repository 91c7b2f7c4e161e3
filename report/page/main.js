"use strict";

/** Reads the data of the page and draws it. */
rubato.main = () => {
  const data = JSON.parse(document.getElementById("data").textContent);
  if (data.kind === "comparison") {
    rubato.comparison(data);
  } else {
    const facts = data.summary.filter(([, , , isHeadline]) => isHeadline);
    rubato.tables.head(data.title, `${data.provenance.record} \u00b7 Rubato ${data.provenance.version}${data.provenance.finished ? "" : " \u00b7 not finished"}`, facts);
    ({ orbit: rubato.orbit, lattice: rubato.lattice, ensemble: rubato.ensemble })[data.kind](data);
    rubato.tables.laws(["Law or figure", "Value", "Remark"], data.summary.map((line) => line.slice(0, 3)), data.kind === "ensemble" ? "Figures over the members" : undefined);
    rubato.tables.origin([data]);
  }
  rubato.tables.foot();
  document.documentElement.dataset.ready = "yes";
};
