// The recurrences of orders d ≥ 1, included once per instruction set by taylor_<set>.cpp, which defines
// RUBATO_XSIMD_NAMESPACE (a name of its own for everything in xsimd) and RUBATO_XSIMD_ARCH. As in batch_kernel.ipp,
// nothing may be left behind that the linker could choose for the rest of the program: everything stands in an
// anonymous namespace, and there is nothing of the standard library but declarations.
//
// For u = f(a) the derivation D, (D u)_d = d·u_d, obeys the chain rule D u = f'(a)·D a; comparing parts of order d
// gives u_d from earlier ones.

#define xsimd RUBATO_XSIMD_NAMESPACE
#include <xsimd/xsimd.hpp>

#include <rubato/formula/taylor_kernel.hpp>
#include <rubato/formula/vector_pair.hpp>

namespace rubato::formula::taylor {
namespace {

using Wide = xsimd::batch<double, xsimd::RUBATO_XSIMD_ARCH>;
using Pair = xsimd::batch<double, xsimd::RUBATO_XSIMD_PAIR>;

/// One or more vectors of neighbouring lanes; T is a vector or a double.
template <typename T, int count>
struct Lanes {
  T v[count];
  static constexpr std::size_t vector = sizeof(T) / sizeof(double);
  static constexpr std::size_t size = vector * count;

  [[gnu::always_inline]] inline static Lanes all(double x) {
    Lanes result;
    for (int i = 0; i < count; ++i)
      result.v[i] = T(x);
    return result;
  }
  [[gnu::always_inline]] inline static Lanes load(const double* from) {
    Lanes result;
    for (int i = 0; i < count; ++i) {
      if constexpr (vector == 1)
        result.v[i] = from[i];
      else
        result.v[i] = T::load_unaligned(from + vector * i);
    }
    return result;
  }
  [[gnu::always_inline]] inline void store(double* to) const {
    for (int i = 0; i < count; ++i) {
      if constexpr (vector == 1)
        to[i] = v[i];
      else
        v[i].store_unaligned(to + vector * i);
    }
  }
  [[gnu::always_inline]] friend inline Lanes operator+(Lanes a, const Lanes& b) {
    for (int i = 0; i < count; ++i)
      a.v[i] = a.v[i] + b.v[i];
    return a;
  }
  [[gnu::always_inline]] friend inline Lanes operator-(Lanes a, const Lanes& b) {
    for (int i = 0; i < count; ++i)
      a.v[i] = a.v[i] - b.v[i];
    return a;
  }
  [[gnu::always_inline]] friend inline Lanes operator*(Lanes a, const Lanes& b) {
    for (int i = 0; i < count; ++i)
      a.v[i] = a.v[i] * b.v[i];
    return a;
  }
  [[gnu::always_inline]] friend inline Lanes operator/(Lanes a, const Lanes& b) {
    for (int i = 0; i < count; ++i)
      a.v[i] = a.v[i] / b.v[i];
    return a;
  }
  [[gnu::always_inline]] friend inline Lanes operator*(double x, const Lanes& a) { return all(x) * a; }
};

struct One {
  [[gnu::always_inline]] inline double operator()(int) const { return 1.0; }
};
struct ByOrder {
  [[gnu::always_inline]] inline double operator()(int k) const { return k; }
};
struct Table {
  const double* weights;
  [[gnu::always_inline]] inline double operator()(int k) const { return weights[k]; }
};

/// The recurrences for some neighbouring lanes at order d.
template <typename L>
struct Recurrence {
  double* series;
  std::size_t series_stride, width, lane;
  int d;

  [[nodiscard, gnu::always_inline]] inline double* at(std::uint32_t s, int order = 0) const {
    return series + s * series_stride + static_cast<std::size_t>(order) * width + lane;
  }
  [[nodiscard, gnu::always_inline]] inline L part(std::uint32_t s) const { return L::load(at(s, d)); }
  [[nodiscard, gnu::always_inline]] inline L leading(std::uint32_t s) const { return L::load(at(s)); }
  [[gnu::always_inline]] inline void set(std::uint32_t s, const L& value) const { value.store(at(s, d)); }

  /// Σ_{k=from..to} weight(k)·a_k·b_{d-k}, in two sums so that an addition need not wait for the one before.
  template <typename Weight = One>
  [[nodiscard, gnu::always_inline]] inline L products(std::uint32_t a, std::uint32_t b, int from, int to,
                                                      Weight weight = {}) const {
    const double* x = at(a, from);
    const double* y = at(b, d - from);
    const auto term = [&](int k, const double* p, const double* q) __attribute__((always_inline)) {
      if constexpr (__is_same(Weight, One))
        return L::load(p) * L::load(q);
      else
        return (weight(k) * L::load(p)) * L::load(q);
    };
    L even = L::all(0.0);
    L odd = L::all(0.0);
    int k = from;
    for (; k < to; k += 2) {
      even = even + term(k, x, y);
      odd = odd + term(k + 1, x + width, y - width);
      x += 2 * width;
      y -= 2 * width;
    }
    if (k == to)
      even = even + term(k, x, y);
    return even + odd;
  }
  /// Parts d of x and y from Σ_{k=1..d} c_k·y_{d-k} and Σ_{k=1..d} c_k·x_{d-k}, times their factors over d.
  [[gnu::always_inline]] inline void integrate_pair(std::uint32_t c, std::uint32_t x, double x_factor, std::uint32_t y,
                                                    double y_factor) const {
    const double* p = at(c, 1);
    const double* u = at(x, d - 1);
    const double* v = at(y, d - 1);
    L first = L::all(0.0);
    L second = L::all(0.0);
    for (int k = 1; k <= d; ++k) {
      const L weight = L::load(p);
      first = first + weight * L::load(v);
      second = second + weight * L::load(u);
      p += width;
      u -= width;
      v -= width;
    }
    set(x, (x_factor / d) * first);
    set(y, (y_factor / d) * second);
  }
  /// Σ_{k=from..d-from} a_k·a_{d-k}, each pair once.
  [[nodiscard, gnu::always_inline]] inline L squares(std::uint32_t a, int from) const {
    const L pairs = 2.0 * products(a, a, from, (d - 1) / 2);
    if (d % 2 != 0 || d / 2 < from)
      return pairs;
    const L middle = L::load(at(a, d / 2));
    return pairs + middle * middle;
  }
  /// factor/d · Σ_{k=1..d} k a_k v_{d-k}: the part of order d of the integral of factor·v·D a.
  [[nodiscard, gnu::always_inline]] inline L integral(std::uint32_t a, std::uint32_t v, double factor) const {
    return (factor / d) * products(a, v, 1, d, ByOrder{});
  }

  [[gnu::always_inline]] inline void extend(const Step& s, const double* weights) const {
    switch (s.kind) {
      case Kind::fill:
      case Kind::sign: set(s.target, L::all(0.0)); break;
      case Kind::add: set(s.target, part(s.a) + part(s.b)); break;
      case Kind::subtract: set(s.target, part(s.a) - part(s.b)); break;
      case Kind::affine: set(s.target, s.factor * part(s.a)); break;
      case Kind::divide_by_number: set(s.target, part(s.a) / L::all(s.value)); break;
      case Kind::multiply: set(s.target, products(s.a, s.b, 0, d)); break;
      case Kind::square: set(s.target, squares(s.a, 0)); break;
      case Kind::divide:  // b·u = a
        set(s.target, (part(s.a) - products(s.b, s.target, 1, d)) / leading(s.b));
        break;
      case Kind::reciprocal:  // a·u = 1
        set(s.target, L::all(-1.0) * products(s.a, s.target, 1, d) / leading(s.a));
        break;
      case Kind::square_root:  // u² = a
        set(s.target, (part(s.a) - squares(s.target, 1)) / (2.0 * leading(s.target)));
        break;
      case Kind::power:  // a·D u = p·u·D a
        set(s.target, products(s.a, s.target, 1, d, Table{weights}) / leading(s.a));
        break;
      case Kind::exponential:
        set(s.c, static_cast<double>(d) * part(s.a));
        set(s.target, (1.0 / d) * products(s.c, s.target, 1, d));
        break;
      case Kind::quotient_integral:  // b·D u = factor·D a
        set(s.target, (s.factor * part(s.a) - (1.0 / d) * products(s.target, s.b, 1, d - 1, ByOrder{})) / leading(s.b));
        break;
      case Kind::circular:
        set(s.c, static_cast<double>(d) * part(s.a));
        integrate_pair(s.c, s.target, 1.0, s.b, -1.0);
        break;
      case Kind::hyperbolic:
        set(s.c, static_cast<double>(d) * part(s.a));
        integrate_pair(s.c, s.target, 1.0, s.b, 1.0);
        break;
      case Kind::tangent:
        set(s.target, integral(s.a, s.b, 1.0));
        set(s.b, squares(s.target, 0));
        break;
      case Kind::secant:  // D sech = -sech tanh D a, D tanh = sech² D a; D csch = -csch coth D a, D coth = -csch² D a
        set(s.target, integral(s.a, s.c, -1.0));
        set(s.b, integral(s.a, s.d, s.factor));
        set(s.c, products(s.target, s.b, 0, d));
        set(s.d, squares(s.target, 0));
        break;
      case Kind::argument: {  // (a² + b²)·D u = b·D a - a·D b
        set(s.c, squares(s.a, 0) + squares(s.b, 0));
        const L moments = products(s.a, s.b, 0, d, Table{weights}) - products(s.target, s.c, 1, d - 1, ByOrder{});
        set(s.target, (1.0 / d) * moments / leading(s.c));
        break;
      }
      case Kind::absolute:
        for (std::size_t l = 0; l < L::size; ++l)
          at(s.target, d)[l] = (at(s.a)[l] > 0.0 ? 1.0 : at(s.a)[l] < 0.0 ? -1.0 : 0.0) * at(s.a, d)[l];
        break;
      case Kind::minimum:
      case Kind::maximum:
        for (std::size_t l = 0; l < L::size; ++l) {
          const bool first = s.kind == Kind::minimum ? at(s.a)[l] < at(s.b)[l] : at(s.a)[l] > at(s.b)[l];
          at(s.target, d)[l] = at(first ? s.a : s.b, d)[l];
        }
        break;
      case Kind::function:  // D F_k(a) = (k+1) F_{k+1}(a) D a for F_k = F^(k)/k!
        for (int k = 0; k + d <= static_cast<int>(s.d); ++k) {
          const std::uint32_t next = s.c + static_cast<std::uint32_t>(k);
          set(k == 0 ? s.target : next - 1, integral(s.a, next, k + 1.0));
        }
        break;
      case Kind::choice:
        for (std::size_t l = 0; l < L::size; ++l)
          at(s.target, d)[l] = (s.factor > 0.0) == (at(s.a)[l] > 0.0) ? at(s.b, d)[l] : 0.0;
        break;
    }
  }
};

/// Steps of one kind, known to the compiler, for the lanes from `lane` on.
template <Kind kind, typename L>
[[gnu::always_inline]] inline void extend_steps(const Work& work, std::size_t lane, const Step* begin, const Step* end,
                                                int d) {
  const Recurrence<L> recurrence{work.series, work.series_stride, work.width, lane, d};
  const double per_order = 1.0 / d;
  if constexpr (kind == Kind::argument) {
    for (int k = 0; k <= d; ++k)
      work.weights[k] = 2 * k - d;
  }
  for (const Step* step = begin; step != end; ++step) {
    if constexpr (kind == Kind::power) {
      if (step == begin || step->value != step[-1].value)
        for (int k = 1; k <= d; ++k)
          work.weights[k] = (step->value * k - (d - k)) * per_order;
    }
    Step known = *step;
    known.kind = kind;
    recurrence.extend(known, work.weights);
  }
}

/// Calls body.operator()<L>(lane) for all lanes, in as few and as wide vectors as there are.
template <typename Body>
[[gnu::always_inline]] inline void for_each_vector(std::size_t width, Body body) {
  if (width == 1) {
    body.template operator()<Lanes<double, 1>>(0);
  } else if (Wide::size > Pair::size && width == 2) {
    body.template operator()<Lanes<Pair, 1>>(0);
  } else {
    std::size_t lane = 0;
    for (; lane + 2 * Wide::size <= width; lane += 2 * Wide::size)
      body.template operator()<Lanes<Wide, 2>>(lane);
    for (; lane < width; lane += Wide::size)
      body.template operator()<Lanes<Wide, 1>>(lane);
  }
}

template <Kind kind>
void extend_group(const Work& work, const Step* begin, const Step* end, int d) {
  for_each_vector(work.width,
                  [=, &work]<typename L>(std::size_t lane) { extend_steps<kind, L>(work, lane, begin, end, d); });
}

void extend(const Work& work, const Step* steps, const Group* begin, const Group* end, int d) {
  for (const Group* group = begin; group != end; ++group) {
    const Step* first = steps + group->first;
    const Step* last = first + group->count;
    switch (group->kind) {
#define RUBATO_GROUP(kind) \
  case Kind::kind: extend_group<Kind::kind>(work, first, last, d); break
      RUBATO_GROUP(fill);
      RUBATO_GROUP(add);
      RUBATO_GROUP(subtract);
      RUBATO_GROUP(affine);
      RUBATO_GROUP(divide_by_number);
      RUBATO_GROUP(multiply);
      RUBATO_GROUP(square);
      RUBATO_GROUP(divide);
      RUBATO_GROUP(reciprocal);
      RUBATO_GROUP(square_root);
      RUBATO_GROUP(power);
      RUBATO_GROUP(exponential);
      RUBATO_GROUP(quotient_integral);
      RUBATO_GROUP(circular);
      RUBATO_GROUP(hyperbolic);
      RUBATO_GROUP(tangent);
      RUBATO_GROUP(secant);
      RUBATO_GROUP(argument);
      RUBATO_GROUP(absolute);
      RUBATO_GROUP(sign);
      RUBATO_GROUP(minimum);
      RUBATO_GROUP(maximum);
      RUBATO_GROUP(function);
      RUBATO_GROUP(choice);
#undef RUBATO_GROUP
    }
  }
}

void feed_back(const Work& work, const double* matrix, std::size_t lanes, const std::uint32_t* outputs,
               std::size_t count, int d) {
  const std::size_t width = work.width;
  const std::size_t offset = static_cast<std::size_t>(d) * width;
  for_each_vector(width, [=]<typename L>(std::size_t lane) {
    const auto source = [=](std::size_t m) { return work.series + outputs[m] * work.series_stride + offset; };
    const auto target = [=](std::size_t m) { return work.series + m * work.series_stride + offset + width + lane; };
    std::size_t m = 0;
    for (; m + 1 < count; m += 2) {  // two at a time share the columns
      const double* const first = source(m);
      const double* const second = source(m + 1);
      L sum = L::all(0.0);
      L other = L::all(0.0);
      for (std::size_t i = 0; i < lanes; ++i) {
        const L column = L::load(matrix + i * width + lane);
        sum = sum + first[i] * column;
        other = other + second[i] * column;
      }
      sum.store(target(m));
      other.store(target(m + 1));
    }
    if (m < count) {
      L sum = L::all(0.0);
      for (std::size_t i = 0; i < lanes; ++i)
        sum = sum + source(m)[i] * L::load(matrix + i * width + lane);
      sum.store(target(m));
    }
  });
}

bool finite(const Work& work, const std::uint32_t* some, std::size_t count, int d) {
  bool result = true;
  for_each_vector(work.width, [=, &result]<typename L>(std::size_t lane) {
    L sum = L::all(0.0);
    for (std::size_t m = 0; m < count; ++m) {
      const L part =
          L::load(work.series + some[m] * work.series_stride + static_cast<std::size_t>(d) * work.width + lane);
      sum = sum + (part - part);  // 0, or NaN where a part is not finite
    }
    double lanes[L::size];
    sum.store(lanes);
    for (const double x : lanes)
      result = result && x == 0.0;
  });
  return result;
}

}  // namespace
}  // namespace rubato::formula::taylor
