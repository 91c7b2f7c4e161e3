#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/taylor_kernel.hpp>
#include <rubato/formula/taylor_program.hpp>

/// Truncated power series of the quantities of compiled code, one or several of them side by side.
namespace rubato::formula {

/// Carries series u(t) = Σ_d u[d] t^d through code, all at once or order by order, by the classical recurrences of
/// Taylor arithmetic (Moore; Griewank and Walther, chapter 13). It can do so for several *lanes*, independent series
/// side by side, at the cost of one for every vector of the machine; every lane gets the bits that it would get alone,
/// on every machine. With N the highest order, an instruction costs O(N²) operations for all orders together; computing
/// one more order costs O(d). No allocation after construction.
///
/// Where an operation has no expansion (division by zero, log of a number ≤ 0, sqrt or cbrt at 0, asin at ±1, abs at 0,
/// min and max of arguments that agree at order 0 and differ later, and so on) or a coefficient overflows, the result
/// is Status::undefined and `failure()` says which operation it was. abs and sign of a series that is zero to all
/// orders seen, and min and max of equal series, are what they seem.
class TaylorEvaluator {
public:
  /// \throws std::invalid_argument if `order` < 0, `lanes` < 1 or `code` was compiled with reuse of registers
  TaylorEvaluator(const Bytecode& code, int order, int lanes = 1);

  [[nodiscard]] int order() const { return order_; }
  [[nodiscard]] std::size_t lanes() const { return lanes_; }
  [[nodiscard]] std::size_t input_count() const { return program_.input_count; }
  [[nodiscard]] std::size_t output_count() const { return program_.outputs.size(); }

  /// Coefficient of order d of input m in every lane, to be written before that order is computed.
  [[nodiscard]] std::span<double> input(std::size_t m, int d) { return {at(m, d), lanes_}; }
  /// All coefficients of input m, if there is one lane.
  [[nodiscard]] std::span<double> input(std::size_t m) {
    assert(lanes_ == 1);
    return {at(m), series_stride_};
  }
  /// Coefficient of order d of output j in every lane, once computed.
  [[nodiscard]] std::span<const double> output(std::size_t j, int d) const {
    return {at(program_.outputs[j], d), lanes_};
  }
  /// Coefficients 0 … order of output j in every lane, `lane_stride()` numbers from one order to the next.
  [[nodiscard]] std::span<const double> output_lanes(std::size_t j) const {
    return {at(program_.outputs[j]), series_stride_};
  }
  [[nodiscard]] std::size_t lane_stride() const { return width_; }
  /// All coefficients of output j, if there is one lane; valid up to the orders computed.
  [[nodiscard]] std::span<const double> output(std::size_t j) const {
    assert(lanes_ == 1);
    return {at(program_.outputs[j]), series_stride_};
  }

  /// Starts again: the next order to be computed is 0.
  void restart();
  /// The next order to be computed; `order() + 1` when all are.
  [[nodiscard]] int next_order() const { return next_; }
  /// Computes the outputs' coefficients of the next order from the inputs' up to it. After a failure every further call
  /// fails until restart().
  Status advance();
  /// All orders from the inputs' series.
  Status operator()();

  /// A linear map between lanes for feed_back(): result[i] = Σ_j matrix(i, j)·lane[j].
  class LaneMap {
  public:
    /// \param matrix lanes × lanes, column by column
    LaneMap(const TaylorEvaluator& evaluator, std::span<const double> matrix);

  private:
    friend class TaylorEvaluator;
    std::vector<double> columns_;  ///< of the evaluator's width
  };
  /// The inputs' next coefficients from the outputs' last ones, input(m, d + 1) = map·output(m, d): as many outputs as
  /// inputs, and d < order(). input(m, d + 1) may still be changed, by finite amounts.
  void feed_back(const LaneMap& map);

  /// After Status::undefined: why, for example "abs has no Taylor expansion at 0".
  [[nodiscard]] std::string failure() const;

private:
  static constexpr std::size_t line = 8;
  struct alignas(64) CacheLine {
    double values[line];
  };
  [[nodiscard]] double* at(std::size_t series, int d = 0) {
    return series_.data()->values + series * series_stride_ + static_cast<std::size_t>(d) * width_;
  }
  [[nodiscard]] const double* at(std::size_t series, int d = 0) const {
    return series_.data()->values + series * series_stride_ + static_cast<std::size_t>(d) * width_;
  }
  [[nodiscard]] taylor::Work work();
  bool take_inputs();
  bool start();
  bool start_lane(std::size_t lane);
  [[nodiscard]] bool has_expansion(const taylor::Step& step, std::size_t lane) const;
  bool fails(const taylor::Step& step, std::size_t lanes);

  int order_;
  int next_ = 0;
  bool fed_ = false;           ///< true if the next coefficients of the inputs come from feed_back()
  bool uniform_ = false;       ///< true if the last coefficients of the inputs are the same in all lanes
  std::size_t lanes_, width_;  ///< width_: lanes with padding, which repeats the last lane
  std::size_t series_stride_;
  taylor::Program program_;
  bool kinks_;                     ///< true if any step may lose its expansion at orders above 0
  std::vector<CacheLine> series_;  ///< aligned, so that no vector lies across two lines
  std::vector<double> weights_;

  enum class Failure : std::uint8_t { none, no_expansion, not_finite, input } failure_ = Failure::none;
  OpCode failed_code_{};
  double failed_argument_ = 0.0;
};

/// Taylor coefficients in t of the solution of z' = f(z), z(0) = z_0: (j+1) z[j+1] = f(z)[j]; of several solutions side
/// by side, the lanes.
class TaylorFlow {
public:
  /// `field` computes f: as many outputs as inputs, compiled without reuse of registers.
  /// \throws std::invalid_argument otherwise, or if `order` < 0 or `lanes` < 1
  TaylorFlow(const Bytecode& field, int order, int lanes = 1);

  [[nodiscard]] int order() const { return order_; }
  [[nodiscard]] std::size_t dimension() const { return field_.input_count(); }

  /// Computes the coefficients from z_0, in every lane from its own `initial` values.
  Status operator()(std::span<const double* const> initial);
  Status operator()(std::span<const double> initial) {  ///< if there is one lane
    const double* const only[] = {initial.data()};
    return (*this)(only);
  }
  /// Coefficient of order j of component m in a lane.
  [[nodiscard]] double coefficient(std::size_t m, int j, std::size_t lane = 0) const {
    return coefficients_[(m * (static_cast<std::size_t>(order_) + 1) + static_cast<std::size_t>(j)) * lanes_ + lane];
  }
  /// The truncated series at t, in a lane.
  void evaluate(double t, std::span<double> z, std::size_t lane = 0) const;
  [[nodiscard]] std::string failure() const { return field_.failure(); }

private:
  int order_;
  std::size_t lanes_;
  TaylorEvaluator field_;
  std::vector<double> coefficients_;  ///< by component, order, lane
};

}  // namespace rubato::formula
