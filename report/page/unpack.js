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
  const array = (packed) => new kinds[packed.type](bytes(packed.data));

  /** The code of values that are not finite. */
  const undefinedCode = 65535;
  const steps = 65534;

  /** Codes with the way back to values. */
  const coded = (packed) => {
    const scale = (packed.maximum - packed.minimum) / steps;
    return {
      codes: array(packed),
      minimum: packed.minimum,
      maximum: packed.maximum,
      value: (code) => (code === undefinedCode ? NaN : packed.minimum + code * scale),
      code: (value) => (scale > 0 ? (value - packed.minimum) / scale : 0),
    };
  };

  return { array, coded, undefinedCode, steps };
})();
