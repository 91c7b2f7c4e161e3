"use strict";

/** The arrays that packing.cpp wrote. What is not finite comes back as NaN. */
rubato.unpack = (() => {
  const bytes = (text) => {
    const binary = atob(text);
    const array = new Uint8Array(binary.length);
    for (let i = 0; i < binary.length; ++i) array[i] = binary.charCodeAt(i);
    return array.buffer;
  };
  const kinds = { f64: Float64Array, f32: Float32Array, u16: Uint16Array };

  /** Typed numbers; for "u16" the codes. */
  const array = (packed) => {
    const numbers = new kinds[packed.type](bytes(packed.data));
    return packed.scale === undefined ? numbers : Float64Array.from(numbers, (number) => packed.base + packed.scale * number);
  };

  /** The code of values that are not finite. */
  const undefinedCode = 65535;
  const steps = 65534;

  /** Codes with the way back to values. */
  const coded = (packed) => {
    const { minimum, maximum } = packed;
    const range = maximum / 2 - minimum / 2;
    return {
      codes: array(packed),
      minimum, maximum,
      value: (code) => (code === undefinedCode ? NaN : minimum * (1 - code / steps) + maximum * (code / steps)),
      code: (value) => (range > 0 ? (value / 2 - minimum / 2) / range * steps : 0),
    };
  };

  return { array, coded, undefinedCode, steps };
})();
