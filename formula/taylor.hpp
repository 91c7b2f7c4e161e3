#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <rubato/base/outcome.hpp>
#include <rubato/formula/bytecode.hpp>

/// Truncated power series of the quantities of compiled code: univariate, and the bivariate ones of generating
/// functions.
///
/// Every series is graded: u = Σ_d u_d with u_d of order d, where a product's part of order d needs only parts up to
/// order d of its factors, and the part of order 0 is a number. With the grading derivation (D u)_d = d·u_d the
/// classical recurrences of Taylor arithmetic (Moore; Griewank and Walther, chapter 13) read the same whatever the
/// parts are made of, and every function of the leading part is a function of a number.
namespace rubato::formula {

/// u(t) = Σ_d u[d] t^d: the part of order d is one number.
struct Univariate {
  [[nodiscard]] static constexpr std::size_t size(int) { return 1; }
  [[nodiscard]] static constexpr std::size_t offset(int order) { return static_cast<std::size_t>(order); }
};

/// u(s, t) = Σ_d Σ_i u[d][i] s^(d-i) t^i, graded by total degree d: the part of order d is d + 1 numbers, by powers of
/// t.
struct Bivariate {
  static constexpr int stride = 1;  ///< between the powers of t
  [[nodiscard]] static constexpr std::size_t size(int order) { return static_cast<std::size_t>(order) + 1; }
  [[nodiscard]] static constexpr std::size_t offset(int order) { return size(order) * (size(order) - 1) / 2; }
};

/// The same for u even in t: u(s, t) = Σ_d Σ_i u[d][i] s^(d-2i) t^(2i). Half the numbers and a quarter of the work.
struct EvenBivariate {
  static constexpr int stride = 2;
  [[nodiscard]] static constexpr std::size_t size(int order) { return static_cast<std::size_t>(order) / 2 + 1; }
  [[nodiscard]] static constexpr std::size_t offset(int order) {
    return size(order) * (size(order) - (order % 2 == 0 ? 1 : 0));
  }
};

/// Carries series through code, all at once or order by order. With N the highest order, an instruction costs O(N²)
/// operations for all orders together in one variable and O(N⁴) in two; computing one more order costs O(d), O(d³). No
/// allocation after construction.
///
/// Where an operation has no expansion (division by zero, log of a number ≤ 0, sqrt or cbrt at 0, asin at ±1, abs at 0,
/// min and max of arguments that agree at order 0 and differ later, and so on) or a coefficient overflows, the result
/// is Status::undefined and `failure()` says which operation it was. abs and sign of a series that is zero to all
/// orders seen, and min and max of equal series, are what they seem.
template <typename Grading>
class BasicTaylorEvaluator {
public:
  /// \throws std::invalid_argument if `order` < 0 or `code` was compiled with reuse of registers
  BasicTaylorEvaluator(const Bytecode& code, int order);

  [[nodiscard]] int order() const { return order_; }
  [[nodiscard]] std::size_t input_count() const { return input_count_; }
  [[nodiscard]] std::size_t output_count() const { return outputs_.size(); }

  /// Part of order d of input m, to be written before that order is computed: `Grading::size(d)` numbers.
  [[nodiscard]] std::span<double> input(std::size_t m, int d) { return part(m, d); }
  /// All parts of input m one after the other.
  [[nodiscard]] std::span<double> input(std::size_t m) { return {series_.data() + m * stride_, stride_}; }
  /// Part of order d of output j, once computed.
  [[nodiscard]] std::span<const double> output(std::size_t j, int d) const {
    return {series_.data() + outputs_[j] * stride_ + Grading::offset(d), Grading::size(d)};
  }
  /// All parts of output j, valid up to the orders computed.
  [[nodiscard]] std::span<const double> output(std::size_t j) const {
    return {series_.data() + outputs_[j] * stride_, stride_};
  }

  /// Starts again: the next order to be computed is 0.
  void restart();
  /// The next order to be computed; `order() + 1` when all are.
  [[nodiscard]] int next_order() const { return next_; }
  /// Computes the outputs' parts of the next order from the inputs' parts up to it. After a failure every further call
  /// fails until restart().
  Status advance();
  /// All orders from the inputs' series.
  Status operator()();

  /// After Status::undefined: why, for example "abs has no Taylor expansion at 0".
  [[nodiscard]] std::string failure() const;

private:
  enum class Kind : std::uint8_t {
    fill,  // target = value, a number
    add,
    subtract,
    affine,            // value + factor·a
    divide_by_number,  // a / value
    multiply,
    square,
    divide,
    reciprocal,
    square_root,
    power,  // a^value
    exponential,
    quotient_integral,  // D target = factor·(D a)/b
    circular,           // target = sin a, b = cos a
    hyperbolic,         // target = sinh a, b = cosh a
    tangent,            // target = tan a (factor 1) or tanh a (factor -1); b = 1 + factor·target²
    secant,    // target = sech a, b = tanh a (factor 1); csch a, coth a (factor -1); c = target·b, d = target²
    argument,  // atan2(a, b); c = a² + b²
    absolute,
    sign,
    minimum,
    maximum,
  };

  /// A step on series: what an instruction is lowered to.
  struct Step {
    Kind kind{};
    OpCode code{};  ///< of the instruction it stems from
    std::uint32_t target = 0, a = 0, b = 0, c = 0, d = 0;
    std::uint32_t culprit = 0;  ///< the argument to be named if there is no expansion
    double value = 0.0, factor = 0.0;
  };

  void lower(const Instruction& instruction, const Bytecode& code);
  void lower_power(const Step& step, std::int64_t exponent);
  std::uint32_t new_series();
  [[nodiscard]] std::span<double> part(std::size_t series, int d) {
    return {series_.data() + series * stride_ + Grading::offset(d), Grading::size(d)};
  }
  [[nodiscard]] double* at(std::size_t series) { return series_.data() + series * stride_; }

  bool start(const Step& step);          // order 0; false where the operation has no expansion
  bool extend(const Step& step, int d);  // order d ≥ 1
  bool inputs_finite(int d);

  int order_ = 0;
  int next_ = 0;
  std::size_t stride_ = 0;
  std::size_t input_count_ = 0;
  std::size_t series_count_ = 0;
  std::vector<double> series_;
  std::vector<std::uint32_t> outputs_;
  std::vector<Step> steps_;

  enum class Failure : std::uint8_t { none, no_expansion, not_finite, input } failure_ = Failure::none;
  OpCode failed_code_{};
  double failed_argument_ = 0.0;
};

extern template class BasicTaylorEvaluator<Univariate>;
extern template class BasicTaylorEvaluator<Bivariate>;
extern template class BasicTaylorEvaluator<EvenBivariate>;

using TaylorEvaluator = BasicTaylorEvaluator<Univariate>;
using BivariateTaylorEvaluator = BasicTaylorEvaluator<Bivariate>;
using EvenBivariateTaylorEvaluator = BasicTaylorEvaluator<EvenBivariate>;

/// Taylor coefficients in s of the solution of z' = f(z), z(0) = z_0: (j+1) z[j+1] = f(z)[j].
class TaylorFlow {
public:
  /// `field` computes f: as many outputs as inputs, compiled without reuse of registers.
  /// \throws std::invalid_argument otherwise, or if `order` < 0
  TaylorFlow(const Bytecode& field, int order);

  [[nodiscard]] int order() const { return order_; }
  [[nodiscard]] std::size_t dimension() const { return dimension_; }

  /// Computes the coefficients from z_0.
  Status operator()(std::span<const double> initial);
  /// Coefficients 0 … order() of component m.
  [[nodiscard]] std::span<const double> coefficients(std::size_t m) const {
    return {coefficients_.data() + m * (static_cast<std::size_t>(order_) + 1), static_cast<std::size_t>(order_) + 1};
  }
  /// The truncated series at s.
  void evaluate(double s, std::span<double> z) const;
  [[nodiscard]] std::string failure() const { return field_.failure(); }

private:
  int order_;
  std::size_t dimension_;
  TaylorEvaluator field_;
  std::vector<double> coefficients_;
};

/// The flow Z(s; c(t)) of z' = f(z) from a point that itself moves along a power series c(t), as series in (s, t) to
/// total degree `order()`, built degree by degree so that c may be found on the way (theory, section 4: c(t) is defined
/// by an equation at s = ±t/2).
///
/// Given the coefficients of c up to t^d, the parts of Z of degree d + 1 are known but for that of s^0, which is the
/// coefficient of t^(d+1) in c. So an equation c(t) = w + (terms with at least one factor s) gives one
/// coefficient of c after the other, in one pass of cost O(order⁴) per instruction of f. With EvenBivariate, c and with
/// it Z are even in t, and the coefficients of odd powers that are handed in must be 0.
template <typename Grading>
class BasicTaylorFlowFamily {
public:
  /// `field` as for TaylorFlow.
  BasicTaylorFlowFamily(const Bytecode& field, int order);

  [[nodiscard]] int order() const { return order_; }
  [[nodiscard]] std::size_t dimension() const { return dimension_; }

  /// Starts again: the next coefficient is c_0.
  void restart();
  /// Gives the next coefficient c_d of c(t) and computes the parts of degree d + 1 (while d < order()).
  Status extend(std::span<const double> coefficient);
  /// Coefficients of s^(d-ki) t^(ki), i = 0, 1, …, k = Grading::stride, in component m of Z. After extend(c_d) those of
  /// degree d + 1 stand with 0 for s^0.
  [[nodiscard]] std::span<const double> part(std::size_t m, int d) const {
    return {parts_.data() + m * stride_ + Grading::offset(d), Grading::size(d)};
  }
  [[nodiscard]] std::string failure() const { return field_.failure(); }

private:
  int order_;
  int next_ = 0;
  std::size_t dimension_;
  std::size_t stride_;
  BasicTaylorEvaluator<Grading> field_;
  std::vector<double> parts_;
};

extern template class BasicTaylorFlowFamily<Bivariate>;
extern template class BasicTaylorFlowFamily<EvenBivariate>;

using TaylorFlowFamily = BasicTaylorFlowFamily<Bivariate>;
using EvenTaylorFlowFamily = BasicTaylorFlowFamily<EvenBivariate>;

}  // namespace rubato::formula
