"use strict";

/** Reads the data of the page and draws it. */
rubato.main = () => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const labels = ["steps", "step length h", "discrete energy E_k", "node energy H(z_k)", "Gamma", "bridging steps"];
  const facts = data.summary.filter(([label]) => labels.includes(label) || label.startsWith("error in"));
  rubato.tables.head(data.title, `${data.provenance.record} \u00b7 Rubato ${data.provenance.version}${data.provenance.finished ? "" : " \u00b7 not finished"}`, facts);
  (data.kind === "orbit" ? rubato.orbit : rubato.lattice)(data);
  rubato.tables.laws(["Law or figure", "Value", "Remark"], data.summary);
  rubato.tables.origin([data]);
  rubato.tables.foot();
  document.documentElement.dataset.ready = "yes";
};
