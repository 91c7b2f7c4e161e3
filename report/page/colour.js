"use strict";

/**
 * Colours, computed in OKLab (B. Ottosson, 2020), where equal distances look equally large. The maps run along straight
 * lines in it between blue and yellow or blue and orange: a difference along these axes is seen with every common form
 * of colour blindness, and lightness alone tells the order. All points on the lines are colours that sRGB has.
 */
rubato.colour = (() => {
  const lab = (lightness, chroma, degrees) => {
    const hue = degrees * Math.PI / 180;
    return [lightness, chroma * Math.cos(hue), chroma * Math.sin(hue)];
  };
  const toLinear = ([L, a, b]) => {
    const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
    const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
    const s = (L - 0.0894841775 * a - 1.2914855480 * b) ** 3;
    return [
      4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
      -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
      -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s,
    ];
  };
  const encode = (x) => {
    const clipped = Math.min(1, Math.max(0, x));
    return Math.round(255 * (clipped <= 0.0031308 ? 12.92 * clipped : 1.055 * clipped ** (1 / 2.4) - 0.055));
  };
  const rgb = (point) => toLinear(point).map(encode);
  const css = ([red, green, blue]) => `rgb(${red}, ${green}, ${blue})`;

  const between = (from, to, part) => from.map((x, i) => x + (to[i] - x) * part);
  /** 256 colours along a path of points, each leg with as many as its share of them. */
  const table = (...points) => {
    const legs = points.length - 1;
    return Array.from({ length: 256 }, (_, i) => {
      const place = i / 255 * legs;
      const leg = Math.min(Math.floor(place), legs - 1);
      return rgb(between(points[leg], points[leg + 1], place - leg));
    });
  };

  const sequential = table(lab(0.25, 0.09, 266), lab(0.94, 0.13, 102));
  const divergingLight = table(lab(0.38, 0.135, 258), lab(0.97, 0.004, 250), lab(0.47, 0.12, 50));
  const divergingDark = table(lab(0.80, 0.11, 240), lab(0.20, 0.008, 265), lab(0.82, 0.12, 70));

  /** Colours of curves: hues and lightnesses both differ. */
  const hues = [[0.52, 0.15, 258], [0.66, 0.15, 55], [0.58, 0.12, 165], [0.58, 0.17, 350], [0.72, 0.13, 95], [0.45, 0.14, 300]];
  const series = (index) => {
    const [lightness, chroma, hue] = hues[index % hues.length];
    const bend = rubato.theme.isDark() ? 0.16 : -0.02;
    return css(rgb(lab(lightness + bend, chroma * (rubato.theme.isDark() ? 0.85 : 1), hue)));
  };

  /** Stripes, as no map of colours has them, for what is undefined. */
  const undefinedAt = (i, j) => {
    const isDark = rubato.theme.isDark();
    const [one, other] = isDark ? [[120, 124, 134], [60, 64, 74]] : [[150, 152, 158], [216, 217, 220]];
    return (i + j) % 8 < 4 ? one : other;
  };

  return {
    undefinedAt,
    sequential: () => sequential,
    diverging: () => (rubato.theme.isDark() ? divergingDark : divergingLight),
    series,
    css,
  };
})();
