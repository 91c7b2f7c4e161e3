// Opens the pages of make_pages in a headless browser and looks at them as a reader would:
//   node check.mjs FOLDER_OF_PLAYWRIGHT CHROMIUM FOLDER_OF_PAGES [all]
// Pages named broken-… are wrong in one way each: the same checks have to find it. Without `all` those are left out that show
// nothing that others do not, in other numbers or the other scheme.

import { createRequire } from "node:module";
import { mkdtempSync, readdirSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const [, , playwright, executablePath, folder, which] = process.argv;
const { chromium } = createRequire(join(playwright, "index.js"))("playwright-core");

/** What each broken page has to be found out by. */
const expected = { "broken-cut": "errors", "broken-empty": "drawn", "broken-request": "requests", "broken-loud": "errors",
  "broken-mute": "clock", "broken-scheme": "scheme", "broken-rainbow": "colours", "broken-dots": "joined", "broken-choice": "choice",
  "broken-legend": "legend", "broken-bright": "rounding", "broken-hidden": "undefined", "broken-uncounted": "undefined",
  "broken-silent": "thinned", "broken-order": "order", "broken-faint": "contrast", "broken-nameless": "names" };
/** Broken pages whose sound twin is another than the lattice. */
const twins = { "broken-dots": "short", "broken-choice": "orbit", "broken-legend": "bodies", "broken-bright": "quiet", "broken-hidden": "holes",
  "broken-uncounted": "holes", "broken-silent": "thinned", "broken-order": "two-fields" };

/** Defines, in a page, a function that reads a canvas by way of a copy: reading it itself would change how it is kept. */
const defineReading = () => {
  window.pixelsOf = (canvas) => {
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(canvas, 0, 0);
    return copy.getImageData(0, 0, canvas.width, canvas.height).data;
  };
  /** A number that other pixels would hardly have. */
  window.digestOf = (canvas) => {
    let digest = 0;
    for (const pixel of new Uint32Array(pixelsOf(canvas).buffer)) digest = Math.imul(digest ^ pixel, 0x01000193);
    return digest;
  };
};

/** Pages that show all there is; they are looked at in the dark scheme, too. */
const inTheDark = which === "all" ? ["orbit", "bodies", "comparison", "lattice", "holes", "quiet", "plane"] : ["orbit", "holes"];
/** Pages that show what others show, in other numbers. */
const moreOfTheSame = which === "all" ? [] : ["short", "section", "huge", "tiny", "long-orbit", "large-lattice", "lattice-comparison"];

/** How many colours each canvas has that is not merely a layer for cursors, counted to ten. */
const coloursOfCanvases = () => [...document.querySelectorAll(".plane canvas:first-child, .uplot canvas")].map((canvas) => {
  const data = pixelsOf(canvas);
  const colours = new Set();
  for (let i = 0; i < data.length && colours.size < 10; i += 4) {
    if (data[i + 3] > 200) colours.add(data[i] << 16 | data[i + 1] << 8 | data[i + 2]);
  }
  return colours.size;
});

/** The colour in which each curve is drawn, counted on its canvas: zero for a curve that is not there. */
const linesDrawn = () => rubato.pictures.curves.map(({ plot }) => {
  const data = pixelsOf(plot.ctx.canvas);
  const wanted = plot.series.slice(1).map((series) => /rgb\((\d+), (\d+), (\d+)\)/.exec(series.stroke(plot)).slice(1).map(Number));
  return Math.max(...wanted.map(([red, green, blue]) => {
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (Math.abs(data[i] - red) + Math.abs(data[i + 1] - green) + Math.abs(data[i + 2] - blue) < 40) ++count;
    }
    return count;
  }));
});

/** Gathers what is wrong. Of a page that is broken on purpose it is enough to find that: then `found` is thrown. */
class Checker {
  constructor(wanted) {
    this.failures = [];
    this.wanted = wanted;
    this.found = Symbol("found");
    this.patience = wanted ? 1000 : 60000;  // milliseconds
  }
  check(kind, condition, text) {
    if (condition) return;
    this.failures.push({ kind, text });
    if (kind === this.wanted) throw this.found;
  }
  /** Checks what comes with a later frame: looks again until it is right, however slow the machine is. */
  async checkSoon(kind, look, isRight, text) {
    const end = Date.now() + this.patience;
    let seen = await look();
    while (!isRight(seen) && Date.now() < end) {
      await new Promise((done) => { setTimeout(done, 20); });
      seen = await look();
    }
    this.check(kind, isRight(seen), text(seen));
  }
}

/**
 * Of an orbit, how many lines between neighbouring states are not there in the first plane: places half way between states
 * that are some pixels apart are empty.
 */
const gapsInOrbit = () => {
  const data = JSON.parse(document.getElementById("data").textContent);
  if (data.kind !== "orbit") return null;
  const states = rubato.unpackStates(data.states);
  const column = (group, i) => states.columns.filter((one) => one.group === group)[i].values;
  const isPlane = states.columns.filter((one) => one.group === "q").length > 1;
  const [x, y] = [column("q", 0), isPlane ? column("q", 1) : column("p", 0)];
  const frame = rubato.pictures.planes[0].frame();
  const canvas = document.querySelector(".plane canvas:first-child");
  const data4 = pixelsOf(canvas);
  const isDrawn = (left, top) => {
    for (const dx of [-1, 0, 1]) {
      for (const dy of [-1, 0, 1]) {
        if (data4[4 * ((Math.round(top * devicePixelRatio) + dy) * canvas.width + Math.round(left * devicePixelRatio) + dx) + 3] > 40) return true;
      }
    }
    return false;
  };
  let [gaps, lines] = [0, 0];
  for (let i = 0; i + 1 < x.length && lines < 200; ++i) {
    const [a, b, c, d] = [frame.x(x[i]), frame.x(x[i + 1]), frame.y(y[i]), frame.y(y[i + 1])];
    if (states.starts.includes(i + 1) || Math.hypot(b - a, d - c) < 8) continue;
    ++lines;
    if (!isDrawn((a + b) / 2, (c + d) / 2)) ++gaps;
  }
  return { gaps, lines };
};

/** The mean lightness of the last map, inside its axes. */
const lightnessOfLastMap = () => {
  const plane = rubato.pictures.planes[rubato.pictures.planes.length - 1];
  const canvas = [...document.querySelectorAll(".plane canvas:first-child")].pop();
  const data = pixelsOf(canvas);
  const { left, top, width, height } = plane.frame();
  let [sum, count] = [0, 0];
  for (let j = Math.ceil(top) + 4; j < top + height - 4; ++j) {
    for (let i = Math.ceil(left) + 4; i < left + width - 4; ++i) {
      const at = 4 * (Math.round(j * devicePixelRatio) * canvas.width + Math.round(i * devicePixelRatio));
      sum += (data[at] + data[at + 1] + data[at + 2]) / 3;
      ++count;
    }
  }
  return sum / count;
};

/** How many pixels of the last map have one of the two colours of the stripes for what is undefined. */
const stripesOfLastMap = () => {
  const stripes = [[120, 124, 134], [60, 64, 74], [150, 152, 158], [216, 217, 220]].map((colour) => colour.join());
  const data = pixelsOf([...document.querySelectorAll(".plane canvas:first-child")].pop());
  let count = 0;
  for (let i = 0; i < data.length; i += 4) if (stripes.includes([data[i], data[i + 1], data[i + 2]].join())) ++count;
  return count;
};

/** How many pixels of the first plane have the colour of each entry of its legend. */
const pixelsOfLegend = () => {
  const data = pixelsOf(document.querySelector(".plane canvas:first-child"));
  return [...document.querySelectorAll(".legend")][0] ? [...document.querySelector(".legend").children].map((entry) => {
    const [red, green, blue] = /rgb\((\d+), (\d+), (\d+)\)/.exec(entry.querySelector(".swatch").style.background).slice(1).map(Number);
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (data[i + 3] > 100 && Math.abs(data[i] - red) + Math.abs(data[i + 1] - green) + Math.abs(data[i + 2] - blue) < 24) ++count;
    }
    return count;
  }) : [];
};

/** Contrasts (WCAG 2) of the colours of text on those under it. */
const contrasts = () => {
  const probe = document.createElement("span");
  document.body.append(probe);
  const luminance = (name) => {
    probe.style.color = `var(--${name})`;
    const [r, g, b] = getComputedStyle(probe).color.match(/\d+/g).map(Number)
      .map((byte) => byte / 255).map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const all = ["ink", "faint"].flatMap((text) => ["page", "card"].map((ground) => {
    const [low, high] = [luminance(text), luminance(ground)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  }));
  probe.remove();
  return all;
};

/** Controls and pictures that a screen reader has no name for. */
const nameless = () => [...document.querySelectorAll("button, select, input, .plane, .curve, figure")]
  .filter((one) => !(one.getAttribute("aria-label") || one.textContent.trim() || one.closest("label"))).length;

async function checkOrbit(page, checker) {
  const orbit = await page.evaluate(gapsInOrbit);
  if (!orbit) return;
  checker.check("joined", orbit.lines > 0 && orbit.gaps === 0, `${orbit.gaps} of ${orbit.lines} lines of the orbit are not drawn`);
  const menu = page.locator(".choose").first();
  const names = () => page.evaluate(() => rubato.pictures.curves[0].plot.series.slice(1).map(({ label }) => label));
  const before = await names();
  const says = (await page.locator("main").innerText()).includes("choose others above");
  const hasMenu = await menu.count() > 0;
  checker.check("choice", hasMenu, "there is no menu of coordinates");
  checker.check("choice", hasMenu || !says, "the page offers a choice that it does not have");
  if (!hasMenu) return;
  await menu.locator("summary").click();
  const boxes = menu.locator("input");
  const last = boxes.nth(await boxes.count() - 1);
  const name = await last.getAttribute("value");
  const index = () => page.evaluate(() => rubato.pictures.curves.findIndex(({ plot }) => plot.root.closest("figure").querySelector(".choose")));
  const shown = async () => page.evaluate((i) => rubato.pictures.curves[i].plot.series.slice(1).map(({ label }) => label), await index());
  const first = await shown();
  await last.check();
  const next = await shown();
  checker.check("choice", !first.includes(name) && next.includes(name) && next.length > first.length, `choosing ${name} draws ${next}`);
  await last.uncheck();
  checker.check("choice", JSON.stringify(await shown()) === JSON.stringify(first), "what is no longer chosen is still drawn");
  await page.keyboard.press("Escape");
  checker.check("choice", before.length > 0, "no curves");
}

/** What single pages have to show. */
const special = {
  bodies: async (page, checker) => {
    const entries = page.locator(".legend").first().locator("button");
    checker.check("legend", (await entries.allInnerTexts()).join() === "sun,moon", `the legend has ${await entries.allInnerTexts()}`);
    if (await entries.count() === 0) return;
    const before = await page.evaluate(pixelsOfLegend);
    checker.check("legend", before.every((count) => count > 20), `pixels in the colours of the legend: ${before}`);
    await entries.first().click();
    await checker.checkSoon("legend", () => page.evaluate(pixelsOfLegend), (after) => after[0] === 0 && after[1] > 20,
      (after) => `pixels without the first body: ${after}`);
    await entries.first().click();
  },
  numbered: async (page, checker) => {
    const found = await page.evaluate(() => ["x1 y1 x2 y2", "x_a y_a z_a x_b y_b z_b", "x1 x2 y1 y2", "r11 r12 r13 r21 r22 r23", "q1 q2 q3 q4", "x y", "x1 y1 x2", "r1 r2 r3"]
      .map((names) => rubato.bodiesOf(names.split(" ").map((name) => ({ name }))).map(({ name, columns }) => `${name}:${columns}`).join(" ")));
    const wanted = ["1:x1,y1 2:x2,y2", "a:x_a,y_a,z_a b:x_b,y_b,z_b", "1:x1,y1 2:x2,y2", "r1:r11,r12,r13 r2:r21,r22,r23", "", "", "", ""];
    checker.check("legend", JSON.stringify(found) === JSON.stringify(wanted), `bodies are found as ${JSON.stringify(found)}`);
    const entries = await page.locator(".legend").first().locator("button").allInnerTexts();
    checker.check("legend", entries.join() === "1,2", `the legend has ${entries}`);
  },
  quiet: async (page, checker) => {
    const lightness = await page.evaluate(lightnessOfLastMap);
    checker.check("rounding", lightness < 60, `rounding is drawn with a lightness of ${lightness}`);
    checker.check("rounding", (await page.locator("#maps").innerText()).includes("rounding"), "the map does not say where rounding begins");
    const heights = await page.evaluate(() => rubato.pictures.curves.filter(({ plot }) => plot.root.closest("#residuals")).map(({ plot }) => plot.scales.y.max));
    checker.check("rounding", heights.length > 0 && heights.every((top) => top >= -13 + 4), `residual curves end at 10^${heights}`);
  },
  holes: async (page, checker) => {
    checker.check("undefined", await page.evaluate(stripesOfLastMap) > 10, "undefined cells are not striped");
    const map = await page.locator("#maps").innerText();
    checker.check("undefined", /Undefined: 5 of 1,599 values/.test(map), `the map says: ${map}`);
    const curve = await page.locator("#invariants").innerText();
    checker.check("undefined", /Undefined: 5 of 40 values/.test(curve), `the invariant says: ${curve}`);
  },
  thinned: async (page, checker) => {
    const silent = await page.evaluate(() => [...document.querySelectorAll("#orbit figure, #energy figure, #levels figure")]
      .filter((figure) => !figure.innerText.includes("left out")).map((figure) => figure.getAttribute("aria-label")));
    checker.check("thinned", silent.length === 0, `these figures do not say what is left out: ${silent}`);
  },
  "two-fields": async (page, checker) => {
    const title = await page.locator("#fields h3").first().innerText();
    checker.check("order", title === "Field u", `the first field is "${title}"`);
  },
  hostile: async (page, checker) => {
    checker.check("scheme", (await page.locator("h1").innerText()).startsWith("</title><script>"), "the title is not what the record has");
    checker.check("scheme", await page.evaluate(() => document.images.length) === 0, "a name became an image");
  },
};

async function dragAcross(page, box) {
  await page.mouse.move(box.x + box.width * 0.3, box.y + box.height * 0.3);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.45, box.y + box.height * 0.5, { steps: 4 });
  await page.mouse.move(box.x + box.width * 0.6, box.y + box.height * 0.7, { steps: 4 });
  await page.mouse.up();
}

async function boxOf(page, element) {
  await element.evaluate((node) => node.scrollIntoView({ block: "center", behavior: "instant" }));
  return element.boundingBox();
}

async function checkCurve(page, checker) {
  const over = page.locator(".uplot .u-over").first();
  const box = await boxOf(page, over);
  const scale = () => page.evaluate(() => ({ ...rubato.pictures.curves[0].plot.scales.x }));
  const legend = () => page.locator(".u-legend").first().innerText();
  await page.mouse.move(box.x + box.width * 0.25, box.y + box.height / 2);
  const first = await legend();
  await page.mouse.move(box.x + box.width * 0.75, box.y + box.height / 2);
  const second = await legend();
  checker.check("cursor", first !== second && /\d/.test(second), `the legend of a curve stays "${first}"`);
  const whole = await scale();
  await dragAcross(page, box);
  const part = await scale();
  checker.check("zoom", part.max - part.min < 0.6 * (whole.max - whole.min), "dragging does not zoom a curve");
  await page.mouse.dblclick(box.x + box.width / 2, box.y + box.height / 2);
  const again = await scale();
  checker.check("zoom", Math.abs(again.max - whole.max) + Math.abs(again.min - whole.min) < 1e-9, "a double click does not show the whole curve");
}

async function checkPlane(page, checker) {
  const over = page.locator(".plane canvas:nth-child(2)").first();
  const box = await boxOf(page, over);
  const extent = () => page.evaluate(() => rubato.pictures.planes[0].extent());
  const width = ({ x }) => x[1] - x[0];
  const readout = page.locator(".readout").first();
  await page.mouse.move(box.x + box.width * 0.4, box.y + box.height * 0.4);
  const first = await readout.innerText();
  await page.mouse.move(box.x + box.width * 0.6, box.y + box.height * 0.6);
  const second = await readout.innerText();
  checker.check("cursor", first !== second && /\d/.test(second), `the values under the pointer stay "${first}"`);
  const whole = await extent();
  await dragAcross(page, box);
  checker.check("zoom", width(await extent()) < 0.6 * width(whole), "dragging does not zoom a plane");
  await page.mouse.dblclick(box.x + box.width / 2, box.y + box.height / 2);
  checker.check("zoom", width(await extent()) === width(whole), "a double click does not show the whole plane");
  await page.locator(".plane").first().focus();
  await page.keyboard.press("+");
  checker.check("keys", width(await extent()) < width(whole), "the key + does not zoom");
  await page.keyboard.press("0");
  checker.check("keys", width(await extent()) === width(whole), "the key 0 does not show the whole");
}

async function checkClock(page, checker) {
  const output = page.locator(".player output");
  const slider = page.locator(".player input");
  const profiles = () => page.evaluate(() => JSON.stringify(rubato.pictures.curves.filter((curve) => !curve.time).map(({ plot }) => plot.data.slice(1))));
  const planes = () => page.evaluate(() => [...document.querySelectorAll(".plane canvas")].map(digestOf).join());
  await slider.fill("3");
  const before = [await output.innerText(), await profiles(), await planes()];
  await slider.fill("17");
  const after = [await output.innerText(), await profiles(), await planes()];
  checker.check("clock", before[0] !== after[0], "the time shown does not follow the slider");
  checker.check("clock", before[1] === "[]" || before[1] !== after[1], "profiles do not follow the slider");
  checker.check("clock", before[2] !== after[2], "planes do not follow the slider");
  const play = page.locator(".player button").first();
  await play.click();
  await checker.checkSoon("clock", () => output.innerText(), (time) => time !== after[0], () => "playing does not move the time");
  await play.click();
}

/** Colours in OKLab, by the way back from sRGB: not the code that the page makes them with. */
function toLab(rgb) {
  const [r, g, b] = rgb.map((byte) => byte / 255).map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4));
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [0.2104542553 * l + 0.7936177850 * m - 0.0040720468 * s, 1.9779984951 * l - 2.4285922050 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.8086757660 * s];
}

/**
 * How uneven a table of 256 colours is: the longest over the shortest distance between colours 16 places apart. Rounding to
 * bytes moves a colour by up to 0.002, and 16 places are some 0.045: what is even comes out below 1 + 4 (0.002/0.045), or 1.2.
 */
function unevenness(table) {
  const points = table.map(toLab);
  const distances = points.slice(16).map((point, i) => Math.hypot(...point.map((x, axis) => x - points[i][axis])));
  return Math.max(...distances) / Math.min(...distances);
}

/** Lightness alone tells the order of a sequential map, and the distance from zero of each half of a diverging one. */
const risesInLightness = (table) => table.map(toLab).every(([lightness], i, all) => i < 8 || lightness > all[i - 8][0]);

async function checkColours(page, checker) {
  const { sequential, diverging } = await page.evaluate(() => ({ sequential: rubato.colour.sequential(), diverging: rubato.colour.diverging() }));
  const halves = [diverging.slice(0, 128), diverging.slice(128)];
  const isLight = toLab(diverging[128])[0] > 0.5;
  checker.check("colours", unevenness(sequential) < 1.2, `the sequential map is uneven: ${unevenness(sequential)}`);
  checker.check("colours", risesInLightness(sequential), "the sequential map does not rise in lightness");
  halves.forEach((half, i) => {
    checker.check("colours", unevenness(half) < 1.2, `half ${i} of the diverging map is uneven: ${unevenness(half)}`);
    checker.check("colours", risesInLightness((i === 0) === isLight ? half : [...half].reverse()), `half ${i} of the diverging map has no order`);
  });
}

/** What a page that is ready shows, and how it answers. */
async function lookAt(page, name, checker) {
  const colours = () => page.evaluate(coloursOfCanvases);
  const areDrawn = (counts) => counts.every((count) => count > 3);
  await checker.checkSoon("drawn", colours, (counts) => counts.length >= 5, (counts) => `only ${counts.length} pictures`);
  await checker.checkSoon("drawn", colours, areDrawn, (counts) => `colours of canvases: ${counts}`);
  await checker.checkSoon("drawn", () => page.evaluate(linesDrawn), (lines) => lines.every((count) => count > 20),
    (lines) => `pixels of curves: ${lines}`);
  await checkColours(page, checker);
  await checkOrbit(page, checker);
  const base = twins[name] || name;
  if (special[base]) await special[base](page, checker);
  checker.check("names", await page.evaluate(nameless) === 0, `${await page.evaluate(nameless)} controls or pictures without a name`);
  const ratios = await page.evaluate(contrasts);
  checker.check("contrast", Math.min(...ratios) >= 4.5, `contrasts of text: ${ratios}`);
  await page.emulateMedia({ media: "print" });
  checker.check("print", !(await page.locator(".player").isVisible()), "the player is printed");
  await page.emulateMedia({ media: "screen" });
  await checkClock(page, checker);
  await checkCurve(page, checker);
  await checkPlane(page, checker);
  const background = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  const first = await background();
  await page.locator("header button").click();
  checker.check("scheme", (await background()) !== first, "the button does not change the scheme");
  await checker.checkSoon("scheme", colours, areDrawn, () => "blank in the other scheme");
  checker.check("scheme", await page.evaluate(() => window.bad === undefined), "text of the record was run");
}

async function checkPage(context, name) {
  const checker = new Checker(expected[name]);
  const page = await context.newPage();
  const url = pathToFileURL(join(folder, `${name}.html`)).href;
  const requests = [];
  const errors = [];
  page.on("request", (request) => requests.push(request.url()));
  page.on("pageerror", (error) => errors.push(error.message));
  page.on("console", (message) => { if (["error", "warning"].includes(message.type())) errors.push(message.text()); });
  await page.addInitScript(defineReading);
  const begin = Date.now();
  await page.goto(url);
  const ready = await page.waitForFunction(() => document.documentElement.dataset.ready === "yes", null, { timeout: expected[name] === "errors" ? 3000 : 120000 }).catch(() => null);
  const milliseconds = Date.now() - begin;
  try {
    checker.check("errors", ready !== null, "the page does not become ready");
    if (ready) await lookAt(page, name, checker);
    checker.check("requests", requests.length === 1 && requests[0] === url, `requests: ${requests.slice(0, 5)}`);
    checker.check("errors", errors.length === 0, `errors: ${errors.slice(0, 3)}`);
  } catch (reason) {
    if (reason !== checker.found) throw reason;
  }
  const background = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  await page.close();
  return { failures: checker.failures, milliseconds, looked: Date.now() - begin, background };
}

async function withBrowser(colorScheme, use) {
  const profile = mkdtempSync(join(tmpdir(), "rubato-browser-"));
  const context = await chromium.launchPersistentContext(profile, {
    executablePath, headless: true, colorScheme, viewport: { width: 1280, height: 900 },
    args: ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
      "--disable-component-update", "--disable-sync"],
  });
  try {
    return await use(context);
  } finally {
    await context.close();
    rmSync(profile, { recursive: true, force: true });
  }
}

const names = readdirSync(folder).filter((file) => file.endsWith(".html")).map((file) => file.replace(/\.html$/, ""))
  .filter((name) => !moreOfTheSame.includes(name)).sort();
let wrong = 0;
const seen = {};
const atOnce = 2;  // each in a browser of its own: what is behind another page is hardly drawn
for (const scheme of ["light", "dark"]) {
  const shown = names.filter((name) => scheme === "light" || inTheDark.includes(name));
  const left = [...shown];
  const results = {};
  await Promise.all(Array.from({ length: atOnce }, () => withBrowser(scheme, async (context) => {
    while (left.length > 0) {
      const name = left.shift();
      results[name] = await checkPage(context, name);
    }
  })));
  for (const name of shown) {
    const { failures, milliseconds, looked, background } = results[name];
    if (expected[name]) {
      const found = failures.some(({ kind }) => kind === expected[name]);
      console.log(`${found ? "found" : "MISSED"}  ${name} (${looked} ms): ${failures.map(({ text }) => text).join("; ").slice(0, 120)}`);
      wrong += found ? 0 : 1;
    } else {
      console.log(`${failures.length === 0 ? "ok" : "FAILED"}  ${name}, ${scheme}, ready after ${milliseconds} ms, looked at for ${looked} ms`);
      failures.forEach(({ kind, text }) => console.log(`    ${kind}: ${text}`));
      wrong += failures.length;
      seen[scheme] = background;
    }
  }
}
if (seen.light === seen.dark) {
  console.log("FAILED  both schemes look the same");
  ++wrong;
}
process.exit(wrong === 0 ? 0 : 1);
