// The vector kernel, included once per instruction set by batch_<set>.cpp, which defines RUBATO_XSIMD_NAMESPACE (a name
// of its own for everything in xsimd) and RUBATO_XSIMD_ARCH.
//
// A translation unit compiled for a wide instruction set must leave no inline function behind that the linker could
// choose for the rest of the program: hence xsimd under another name, everything here in an anonymous namespace, and
// nothing of the standard library but declarations.

#define xsimd RUBATO_XSIMD_NAMESPACE
#include <xsimd/xsimd.hpp>

#include <rubato/formula/batch_kernel.hpp>
#include <rubato/formula/scalar_functions.hpp>

namespace rubato::formula::batch {
namespace {

using Batch = xsimd::batch<double, xsimd::RUBATO_XSIMD_ARCH>;
using Bits = xsimd::batch<std::int64_t, xsimd::RUBATO_XSIMD_ARCH>;
using Mask = Batch::batch_bool_type;
constexpr std::size_t lanes = Batch::size;
static_assert(lanes <= widest_vector && widest_vector % lanes == 0);

/// Calls body(k) for the first point k of every vector. `points` by value: the compiler must take a store through a
/// vector pointer for one that might change the block.
template <typename Body>
[[gnu::always_inline]] inline void for_each_vector(std::size_t points, Body body) {
  for (std::size_t k = 0; k < points; k += widest_vector)
    for (std::size_t l = 0; l < widest_vector; l += lanes)
      body(k + l);
}

template <typename Function>
void unary(const Block& block, const Instruction& i, Function f) {
  const double* a = block.read[i.a];
  double* target = block.write[i.target];
  for_each_vector(block.points, [=](std::size_t k) { f(Batch::load_unaligned(a + k)).store_unaligned(target + k); });
}

template <typename Function>
void binary(const Block& block, const Instruction& i, Function f) {
  const double* a = block.read[i.a];
  const double* b = block.read[i.b];
  double* target = block.write[i.target];
  for_each_vector(block.points, [=](std::size_t k) {
    f(Batch::load_unaligned(a + k), Batch::load_unaligned(b + k)).store_unaligned(target + k);
  });
}

template <typename Function>
void ternary(const Block& block, const Instruction& i, Function f) {
  const double* a = block.read[i.a];
  const double* b = block.read[i.b];
  const double* c = block.read[i.c];
  double* target = block.write[i.target];
  for_each_vector(block.points, [=](std::size_t k) {
    f(Batch::load_unaligned(a + k), Batch::load_unaligned(b + k), Batch::load_unaligned(c + k))
        .store_unaligned(target + k);
  });
}

/// The lanes of `result` outside `inside` computed one by one.
[[gnu::noinline, gnu::cold]] Batch patched(OpCode code, Batch x, Mask inside, Batch result) {
  alignas(Batch) double arguments[lanes], results[lanes], good[lanes];
  x.store_aligned(arguments);
  result.store_aligned(results);
  xsimd::select(inside, Batch(1.0), Batch(0.0)).store_aligned(good);
  for (std::size_t lane = 0; lane < lanes; ++lane)
    if (good[lane] == 0.0)
      results[lane] = scalar_function(code)(arguments[lane], 0.0);
  return Batch::load_aligned(results);
}

/// Applies `f` where `inside(x)`, elsewhere the C library. The vector function sees `harmless` in lanes outside: its
/// choice of a path by the worst lane must not touch the others, or a result would depend on its neighbours.
template <typename Inside, typename Function>
void guarded(const Block& block, const Instruction& i, double harmless, Inside inside, Function f) {
  const OpCode code = i.code;
  unary(block, i, [=](Batch x) {
    const Mask good = inside(x);
    const Batch y = f(xsimd::select(good, x, Batch(harmless)));
    return xsimd::all(good) ? y : patched(code, x, good, y);
  });
}

/// Σ c_i x^i by Horner's rule.
template <typename... Coefficients>
[[gnu::always_inline]] inline Batch polynomial(Batch x, double first, Coefficients... rest) {
  if constexpr (sizeof...(rest) == 0)
    return Batch(first);
  else
    return Batch(first) + x * polynomial(x, rest...);
}

// Adding this to a number below 2^51 leaves the nearest integer in the lowest bits of the sum.
constexpr double integer_shift = 0x1.8p52;

// Angles up to this size are reduced by Cody and Waite's method in the vector; n = x/(π/2) then has at most 17 bits, so
// that its products with 33-bit parts of π/2 are exact.
constexpr double largest_angle = 1e5;
constexpr auto small_angle = [](Batch x) { return xsimd::abs(x) <= Batch(largest_angle); };

struct SineCosine {
  Batch sin, cos;
};

/// Sine and cosine for |x| ≤ largest_angle.
[[gnu::always_inline]] inline SineCosine sine_and_cosine(Batch x) {
  const Batch angle = xsimd::abs(x);
  const Batch shifted = angle * Batch(0x1.45f306dc9c883p-1) + Batch(integer_shift);
  const Batch n = shifted - Batch(integer_shift);
  // π/2 in three parts of 33 bits and a tail. The first difference is exact, and so is each following one that cancels:
  // the remainder is right to one rounding even next to a multiple of π/2.
  Batch r = angle - n * Batch(0x1.921fb544p+0);
  r = r - n * Batch(0x1.0b4611a6p-34);
  r = r - n * Batch(0x1.3198a2ep-69);
  r = r - n * Batch(0x1.b839a252049c1p-104);
  // Interpolation of (sin r - r)/r³ and (cos r - 1 + r²/2)/r⁴ in Chebyshev points of r² ≤ (π/4)²: relative
  // errors 2.1e-17 and 1.3e-18 of sine and cosine.
  const Batch z = r * r;
  const Batch sine = r + r * z *
                             polynomial(z, -0x1.5555555555555p-3, 0x1.1111111110bb2p-7, -0x1.a01a019e83aadp-13,
                                        0x1.71de379689f47p-19, -0x1.ae600b0299686p-26, 0x1.5e0b19ee56c63p-33);
  const Batch half = Batch(0.5) * z;
  const Batch most = Batch(1.0) - half;
  const Batch rest = z * z *
                     polynomial(z, 0x1.5555555555555p-5, -0x1.6c16c16c16967p-10, 0x1.a01a019f4eb00p-16,
                                -0x1.27e4fa17d9fc1p-22, 0x1.1eeb68e92d026p-29, -0x1.907da35d467bfp-37);
  const Batch cosine = most + (((Batch(1.0) - most) - half) + rest);
  // The quadrant stands in the two lowest bits: odd, sine and cosine change places; signs by bit 1.
  const Bits quadrant = xsimd::bitwise_cast<Bits>(shifted);
  const Mask odd = (xsimd::bitwise_cast<Batch>(quadrant << 62) & Batch(2.0)) != Batch(0.0);  // 2.0 is the bit 62 alone
  const Batch sign_bit(-0.0);
  const Batch sine_sign = (xsimd::bitwise_cast<Batch>(quadrant << 62) ^ x) & sign_bit;
  const Batch cosine_sign = xsimd::bitwise_cast<Batch>((quadrant + Bits(1)) << 62) & sign_bit;
  return {xsimd::select(odd, cosine, sine) ^ sine_sign, xsimd::select(odd, sine, cosine) ^ cosine_sign};
}

// Beyond these arguments exp and its relatives overflow or come to subnormal numbers.
constexpr auto exp_range = [](Batch x) { return xsimd::abs(x) < Batch(708.0); };

/// exp x = 2^k exp r for |x| < 708, with |r| ≤ ½ log 2.
[[gnu::always_inline]] inline Batch exponential(Batch x) {
  const Batch shifted = x * Batch(0x1.71547652b82fep+0) + Batch(integer_shift);
  const Batch k = shifted - Batch(integer_shift);
  const Batch r =
      (x - k * Batch(0x1.62e42feep-1)) - k * Batch(0x1.a39ef35793c76p-33);  // log 2 in two parts, the first of 32 bits
  // Interpolation of (exp r - 1 - r)/r² in Chebyshev points: relative error 1.6e-17 of the exponential.
  const Batch e =
      Batch(1.0) + (r + r * r *
                            polynomial(r, 0.5, 0x1.5555555555556p-3, 0x1.5555555553d68p-5, 0x1.11111111109b5p-7,
                                       0x1.6c16c17889ef9p-10, 0x1.a01a01a7c2f03p-13, 0x1.a019b914985a9p-16,
                                       0x1.71de0db2f585ep-19, 0x1.28917c8be7ad6p-22, 0x1.af389ed28db09p-26));
  const Bits exponent = (xsimd::bitwise_cast<Bits>(shifted) + Bits(1023)) << 52;
  return e * xsimd::bitwise_cast<Batch>(exponent);
}

void sincos(const Block& block, const Instruction& i) {
  const double* a = block.read[i.a];
  double* sine = block.write[i.target];
  double* cosine = block.write[i.b];
  for_each_vector(block.points, [=](std::size_t k) {
    const Batch x = Batch::load_unaligned(a + k);
    const Mask good = small_angle(x);
    auto [s, c] = sine_and_cosine(xsimd::select(good, x, Batch(0.0)));
    if (!xsimd::all(good)) {
      s = patched(OpCode::sin, x, good, s);
      c = patched(OpCode::cos, x, good, c);
    }
    s.store_unaligned(sine + k);
    c.store_unaligned(cosine + k);
  });
}

/// By repeated squaring from the lowest bit, in the order of the scalar evaluator.
Batch integer_power(Batch x, std::int32_t exponent) {
  auto rest = exponent < 0 ? 0u - static_cast<std::uint32_t>(exponent) : static_cast<std::uint32_t>(exponent);
  Batch power = x;
  Batch result(1.0);
  for (bool first = true; rest != 0; rest >>= 1) {
    if (rest & 1u) {
      result = first ? power : result * power;
      first = false;
    }
    if (rest > 1)
      power = power * power;
  }
  return exponent < 0 ? Batch(1.0) / result : result;
}

/// What has no form in vectors.
void one_by_one(const Block& block, const Instruction& i) {
  const ScalarFunction of = scalar_function(i.code);
  const double* a = block.read[i.a];
  const double* b = operand_count(i.code) == 2 ? block.read[i.b] : a;
  double* target = block.write[i.target];
  for (std::size_t k = 0; k < block.points; ++k)
    target[k] = of(a[k], b[k]);
}

Mask normal(Batch x) {
  return (x >= Batch(0x1p-1022)) & (x <= Batch(0x1.fffffffffffffp1023));
}

void run_instruction(const Block& block, const Instruction& i) {
  switch (i.code) {
    case OpCode::add: return binary(block, i, [](Batch a, Batch b) { return a + b; });
    case OpCode::subtract: return binary(block, i, [](Batch a, Batch b) { return a - b; });
    case OpCode::multiply: return binary(block, i, [](Batch a, Batch b) { return a * b; });
    case OpCode::divide: return binary(block, i, [](Batch a, Batch b) { return a / b; });
    case OpCode::negate: return unary(block, i, [](Batch a) { return a ^ Batch(-0.0); });
    case OpCode::multiply_add: return ternary(block, i, [](Batch a, Batch b, Batch c) { return a * b + c; });
    case OpCode::multiply_subtract: return ternary(block, i, [](Batch a, Batch b, Batch c) { return a * b - c; });
    case OpCode::negative_multiply_add: return ternary(block, i, [](Batch a, Batch b, Batch c) { return c - a * b; });
    case OpCode::square: return unary(block, i, [](Batch a) { return a * a; });
    case OpCode::integer_power: {
      const auto exponent = static_cast<std::int32_t>(i.b);
      return unary(block, i, [exponent](Batch a) { return integer_power(a, exponent); });
    }
    case OpCode::sin: return guarded(block, i, 0.0, small_angle, [](Batch x) { return sine_and_cosine(x).sin; });
    case OpCode::cos: return guarded(block, i, 0.0, small_angle, [](Batch x) { return sine_and_cosine(x).cos; });
    case OpCode::sincos: return sincos(block, i);
    case OpCode::tan:
      return guarded(block, i, 0.0, small_angle, [](Batch x) {
        const auto [s, c] = sine_and_cosine(x);
        return s / c;
      });
    case OpCode::asin: return unary(block, i, [](Batch a) { return xsimd::asin(a); });
    case OpCode::acos: return unary(block, i, [](Batch a) { return xsimd::acos(a); });
    case OpCode::atan: return unary(block, i, [](Batch a) { return xsimd::atan(a); });
    case OpCode::sinh: return guarded(block, i, 0.0, exp_range, [](Batch a) { return xsimd::sinh(a); });
    case OpCode::cosh:
      return guarded(block, i, 0.0, exp_range, [](Batch a) {
        const Batch half = Batch(0.5) * exponential(xsimd::abs(a));
        return half + Batch(0.25) / half;
      });
    case OpCode::sech:
      return guarded(block, i, 0.0, exp_range, [](Batch a) {
        const Batch e = exponential(-xsimd::abs(a));
        return Batch(2.0) * e / (Batch(1.0) + e * e);
      });
    case OpCode::csch: return guarded(block, i, 1.0, exp_range, [](Batch a) { return Batch(1.0) / xsimd::sinh(a); });
    case OpCode::tanh: return unary(block, i, [](Batch a) { return xsimd::tanh(a); });
    case OpCode::asinh:
      return guarded(
          block, i, 0.0, [](Batch a) { return xsimd::abs(a) < Batch(0x1p500); },
          [](Batch a) { return xsimd::asinh(a); });
    case OpCode::acosh:
      return guarded(
          block, i, 1.0, [](Batch a) { return (a >= Batch(1.0)) & (a < Batch(0x1p500)); },
          [](Batch a) { return xsimd::acosh(a); });
    case OpCode::atanh:
      return guarded(
          block, i, 0.0, [](Batch a) { return xsimd::abs(a) < Batch(1.0); }, [](Batch a) { return xsimd::atanh(a); });
    case OpCode::exp: return guarded(block, i, 0.0, exp_range, [](Batch a) { return exponential(a); });
    case OpCode::log: return guarded(block, i, 1.0, normal, [](Batch a) { return xsimd::log(a); });
    case OpCode::cbrt:
      return guarded(
          block, i, 1.0, [](Batch a) { return normal(xsimd::abs(a)); }, [](Batch a) { return xsimd::cbrt(a); });
    case OpCode::sqrt: return unary(block, i, [](Batch a) { return xsimd::sqrt(a); });
    case OpCode::abs: return unary(block, i, [](Batch a) { return xsimd::abs(a); });
    case OpCode::sign:
      return unary(block, i, [](Batch a) {
        const Batch zero(0.0);
        return xsimd::select(a > zero, Batch(1.0), xsimd::select(a < zero, Batch(-1.0), a));
      });
    case OpCode::min:
      return binary(block, i,
                    [](Batch a, Batch b) { return xsimd::select(a < b, a, xsimd::select(b <= a, b, a + b)); });
    case OpCode::max:
      return binary(block, i,
                    [](Batch a, Batch b) { return xsimd::select(a > b, a, xsimd::select(b >= a, b, a + b)); });
    case OpCode::where_positive:
      return binary(block, i, [](Batch a, Batch b) {
        const Batch zero(0.0);
        return xsimd::select(a > zero, b, xsimd::select(a <= zero, zero, a));
      });
    case OpCode::where_negative:
      return binary(block, i, [](Batch a, Batch b) {
        const Batch zero(0.0);
        return xsimd::select(a <= zero, b, xsimd::select(a > zero, zero, a));
      });
    default: return one_by_one(block, i);
  }
}

void run(const Block& block) {
  for (const Instruction* i = block.begin; i != block.end; ++i)
    run_instruction(block, *i);
}

}  // namespace
}  // namespace rubato::formula::batch
