// The vector kernel, included once per instruction set by batch_<set>.cpp, which defines RUBATO_XSIMD_NAMESPACE (a name
// of its own for everything in xsimd) and RUBATO_XSIMD_ARCH.
//
// A translation unit compiled for a wide instruction set must leave no inline function behind that the linker could
// choose for the rest of the program: hence xsimd under another name, everything here in an anonymous namespace, and
// nothing of the standard library but declarations.

#define xsimd RUBATO_XSIMD_NAMESPACE
#include <xsimd/xsimd.hpp>

#include <rubato/formula/batch_kernel.hpp>

namespace rubato::formula::batch {
namespace {

using Batch = xsimd::batch<double, xsimd::RUBATO_XSIMD_ARCH>;
using Bits = xsimd::batch<std::int64_t, xsimd::RUBATO_XSIMD_ARCH>;
using Mask = Batch::batch_bool_type;
constexpr std::size_t lanes = Batch::size;
static_assert(lanes <= widest_vector && widest_vector % lanes == 0);

template <typename Function>
void unary(const Block& block, const Instruction& i, Function f) {
  const double* a = block.read[i.a];
  double* target = block.write[i.target];
  for (std::size_t k = 0; k < block.points; k += lanes)
    f(Batch::load_unaligned(a + k)).store_unaligned(target + k);
}

template <typename Function>
void binary(const Block& block, const Instruction& i, Function f) {
  const double* a = block.read[i.a];
  const double* b = block.read[i.b];
  double* target = block.write[i.target];
  for (std::size_t k = 0; k < block.points; k += lanes)
    f(Batch::load_unaligned(a + k), Batch::load_unaligned(b + k)).store_unaligned(target + k);
}

template <typename Function>
void ternary(const Block& block, const Instruction& i, Function f) {
  const double* a = block.read[i.a];
  const double* b = block.read[i.b];
  const double* c = block.read[i.c];
  double* target = block.write[i.target];
  for (std::size_t k = 0; k < block.points; k += lanes)
    f(Batch::load_unaligned(a + k), Batch::load_unaligned(b + k), Batch::load_unaligned(c + k))
        .store_unaligned(target + k);
}

/// The lanes of `result` outside `inside` computed one by one.
[[gnu::noinline, gnu::cold]] Batch patched(OpCode code, Batch x, Mask inside, Batch result) {
  alignas(Batch) double arguments[lanes], results[lanes], good[lanes];
  x.store_aligned(arguments);
  result.store_aligned(results);
  xsimd::select(inside, Batch(1.0), Batch(0.0)).store_aligned(good);
  for (std::size_t lane = 0; lane < lanes; ++lane)
    if (good[lane] == 0.0)
      results[lane] = evaluate_scalar(code, arguments[lane], 0.0);
  return Batch::load_aligned(results);
}

/// Applies `f` where `inside(x)`, elsewhere the C library. The vector function sees `harmless` in lanes outside: its
/// choice of a path by the worst lane must not touch the others, or a result would depend on its neighbours.
template <typename Inside, typename Function>
void guarded(const Block& block, const Instruction& i, double harmless, Inside inside, Function f) {
  unary(block, i, [&](Batch x) {
    const Mask good = inside(x);
    const Batch y = f(xsimd::select(good, x, Batch(harmless)));
    return xsimd::all(good) ? y : patched(i.code, x, good, y);
  });
}

struct Reduced {
  Batch sin, cos;  ///< of the remainder in [-π/4, π/4]
  Mask odd;        ///< odd quadrant: sine and cosine change places
  Bits quadrant;   ///< the quadrant in its two lowest bits
};

// Angles up to this size are reduced by Cody and Waite's method in the vector; n = x/(π/2) then has at most 17 bits, so
// that its products with 33-bit parts of π/2 are exact.
constexpr double largest_angle = 1e5;

Mask small_angle(Batch x) {
  return xsimd::abs(x) <= Batch(largest_angle);
}

/// π/2 = part1 + part2 + part3 + tail; the first three have 33 bits. x - n·part1 is exact, and so is each following
/// difference that cancels, so the remainder is right to one rounding even next to a multiple of π/2.
Reduced reduce(Batch x) {
  const Batch shift(0x1.8p52);  // adding it leaves the nearest integer in the lowest bits
  const Batch shifted = x * Batch(0x1.45f306dc9c883p-1) + shift;
  const Batch n = shifted - shift;
  Batch r = x - n * Batch(0x1.921fb544p+0);
  r = r - n * Batch(0x1.0b4611a6p-34);
  r = r - n * Batch(0x1.3198a2ep-69);
  r = r - n * Batch(0x1.b839a252049c1p-104);
  // |r| ≤ π/4 up to a rounding, where xsimd takes each lane as it is.
  const auto [sine, cosine] = xsimd::sincos(r);
  const Bits quadrant = xsimd::bitwise_cast<Bits>(shifted);
  const Mask odd = (xsimd::bitwise_cast<Batch>(quadrant << 62) & Batch(2.0)) != Batch(0.0);  // 2.0 is the bit 62 alone
  return {sine, cosine, odd, quadrant};
}

/// `value` with its sign changed where bit 1 of `quadrant` is set.
Batch signed_by(Batch value, Bits quadrant) {
  return value ^ (xsimd::bitwise_cast<Batch>(quadrant << 62) & Batch(-0.0));
}

Batch sin(const Reduced& r) {
  return signed_by(xsimd::select(r.odd, r.cos, r.sin), r.quadrant);
}
Batch cos(const Reduced& r) {
  return signed_by(xsimd::select(r.odd, r.sin, r.cos), r.quadrant + Bits(1));
}

void sincos(const Block& block, const Instruction& i) {
  const double* a = block.read[i.a];
  double* sine = block.write[i.target];
  double* cosine = block.write[i.b];
  for (std::size_t k = 0; k < block.points; k += lanes) {
    const Batch x = Batch::load_unaligned(a + k);
    const Mask good = small_angle(x);
    const Reduced r = reduce(xsimd::select(good, x, Batch(0.0)));
    Batch s = sin(r);
    Batch c = cos(r);
    if (!xsimd::all(good)) {
      s = patched(OpCode::sin, x, good, s);
      c = patched(OpCode::cos, x, good, c);
    }
    s.store_unaligned(sine + k);
    c.store_unaligned(cosine + k);
  }
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

void one_by_one(const Block& block, const Instruction& i) {
  const double* a = block.read[i.a];
  const double* b = block.read[i.b];
  double* target = block.write[i.target];
  for (std::size_t k = 0; k < block.points; ++k)
    target[k] = evaluate_scalar(i.code, a[k], b[k]);
}

// Beyond these arguments exp and its relatives overflow, or reach numbers that xsimd flushes to zero.
Mask exp_range(Batch x) {
  return xsimd::abs(x) < Batch(708.0);
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
    case OpCode::sin: return guarded(block, i, 0.0, small_angle, [](Batch x) { return sin(reduce(x)); });
    case OpCode::cos: return guarded(block, i, 0.0, small_angle, [](Batch x) { return cos(reduce(x)); });
    case OpCode::sincos: return sincos(block, i);
    case OpCode::tan:
      return guarded(block, i, 0.0, small_angle, [](Batch x) {
        const Reduced r = reduce(x);
        return sin(r) / cos(r);
      });
    case OpCode::asin: return unary(block, i, [](Batch a) { return xsimd::asin(a); });
    case OpCode::acos: return unary(block, i, [](Batch a) { return xsimd::acos(a); });
    case OpCode::atan: return unary(block, i, [](Batch a) { return xsimd::atan(a); });
    case OpCode::sinh: return guarded(block, i, 0.0, exp_range, [](Batch a) { return xsimd::sinh(a); });
    case OpCode::cosh: return guarded(block, i, 0.0, exp_range, [](Batch a) { return xsimd::cosh(a); });
    case OpCode::sech: return guarded(block, i, 0.0, exp_range, [](Batch a) { return Batch(1.0) / xsimd::cosh(a); });
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
    case OpCode::exp: return guarded(block, i, 0.0, exp_range, [](Batch a) { return xsimd::exp(a); });
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
    case OpCode::power:
    case OpCode::atan2: return one_by_one(block, i);
  }
}

void run(const Block& block) {
  for (const Instruction* i = block.begin; i != block.end; ++i)
    run_instruction(block, *i);
}

}  // namespace
}  // namespace rubato::formula::batch
