"use strict";

/** Numbers as text. */
rubato.format = (() => {
  const minus = (text) => text.replace(/-/g, "\u2212");

  /** With `digits` significant digits, and no zeros at the end. */
  const number = (value, digits = 6) => {
    if (value === null || value === undefined || Number.isNaN(value)) return "\u2013";
    if (!Number.isFinite(value)) return value > 0 ? "\u221e" : "\u2212\u221e";
    if (value === 0) return "0";
    const size = Math.abs(value);
    if (size >= 1e-4 && size < 1e7) return minus(String(Number(value.toPrecision(digits))));
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    return minus(`${Number(mantissa)}e${Number(exponent)}`);
  };

  const superscripts = "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079";
  /** 10 to a whole power. */
  const power = (exponent) => "10" + (exponent < 0 ? "\u207b" : "") +
    String(Math.abs(exponent)).split("").map((digit) => superscripts[digit]).join("");

  /** A step of 1, 2 or 5 times a power of ten that divides a range into about `count` parts; 1 if into as many as there are whole numbers. */
  const step = (range, count) => {
    if (count === Infinity) return 1;
    const rough = range / Math.max(count, 1);
    const base = 10 ** Math.floor(Math.log10(rough));
    return base * ([1, 2, 5].find((factor) => factor * base >= rough) || 10);
  };

  /** Round numbers in [low, high]. */
  const ticks = (low, high, count) => {
    if (!(high > low) || !Number.isFinite(high - low)) return [low];
    const spacing = step(high - low, count);
    const first = Math.ceil(low / spacing - 1e-9);
    // Beyond 2^53 there is no next whole number, and between close neighbours no round one.
    if (!(Math.abs(first) < 2 ** 52)) return [low, high];
    const values = [];
    for (let i = 0; i < 1000 && (first + i) * spacing <= high + 1e-9 * spacing; ++i) values.push((first + i) * spacing);
    return values;
  };

  /** Texts of ticks: all with as many digits as tell neighbours apart. */
  const tickTexts = (values) => {
    if (values.length < 2) return values.map((value) => number(value, 4));
    const spacing = Math.abs(values[1] - values[0]);
    const largest = Math.max(...values.map(Math.abs));
    const digits = Math.min(16, Math.max(1, Math.floor(Math.log10(largest)) - Math.floor(Math.log10(spacing)) + 2)) || 1;
    return values.map((value) => number(Math.abs(value) < spacing * 1e-6 ? 0 : value, digits));
  };

  /** How many, with groups of thousands. */
  const count = (value) => value.toLocaleString("en");
  /** A part of a whole, in percent, that is not rounded to none or to all. */
  const percent = (part, whole) => {
    const exact = 100 * part / whole;
    if (exact > 0 && exact < 0.1) return "less than 0.1 %";
    if (exact > 99.9 && exact < 100) return "more than 99.9 %";
    return `${number(exact, exact < 10 ? 2 : 3)} %`;
  };

  return { count, percent, number, power, ticks, tickTexts };
})();
