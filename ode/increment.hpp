#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include <Eigen/Core>

#include <rubato/base/lagrange_weight.hpp>
#include <rubato/base/larger.hpp>
#include <rubato/base/state.hpp>
#include <rubato/ode/state_kernels.hpp>

/// \file
/// What every implicit scheme of this room does with its increment δ_k = z_{k+1} - z_k: predict it, judge corrections
/// to it, and add it to the state without losing its low digits.

namespace rubato {

template <typename Vector>
std::span<double> as_span(Vector& v) {
  return {v.data(), static_cast<std::size_t>(v.size())};
}
template <typename Vector>
std::span<const double> as_span(const Vector& v) {
  return {v.data(), static_cast<std::size_t>(v.size())};
}

/// n of a vector or matrix with 2n rows, known to the compiler where the rows are.
template <typename Object>
auto half_rows(const Object& object) {
  constexpr int rows = Object::RowsAtCompileTime;
  return Eigen::fix < rows == Eigen::Dynamic ? Eigen::Dynamic : rows / 2 > (static_cast<int>(object.rows() / 2));
}

/// f = J g, J = [[0, I], [-I, 0]].
template <typename In, typename Out>
void apply_j(const In& g, Out& f) {
  const auto n = half_rows(g);
  f.head(n) = g.tail(n);
  f.tail(n) = -g.head(n);
}

/// A state kept as high + low, so that many small increments do not lose digits. Adding δ rounds at ε²|z|, not at ε|δ|:
/// a scheme whose δ is rounded from something known better, always to the same side, would drift by that.
template <typename Vector>
class CompensatedState {
public:
  CompensatedState() = default;
  explicit CompensatedState(const Vector& z) : high_(z), low_(Vector::Zero(z.size())), sum_(z), part_(z) {}

  [[nodiscard]] const Vector& value() const { return high_; }  ///< rounded to double
  [[nodiscard]] const Vector& low() const { return low_; }     ///< what rounding left
  /// z + scale·δ, with the low part taken along.
  void displaced(double scale, const Vector& delta, Vector& result) const { result = high_ + (low_ + scale * delta); }

  void add(const Vector& delta) {
    constexpr Eigen::Index long_enough = 16;  // for a call to pay
    if (delta.size() >= long_enough) {
      add_to_state(static_cast<std::size_t>(delta.size()), delta.data(), high_.data(), low_.data());
    } else {
      two_sum(delta);
      renormalise();
    }
  }
  /// δ and what it lost when it was rounded.
  void add(const Vector& delta, const Vector& lost) {
    two_sum(delta);
    low_ += lost;
    renormalise();
  }

  void save(StateWriter& state) const {
    state.write(as_span(high_));
    state.write(as_span(low_));
  }
  void restore(StateReader& state) {
    state.read(as_span(high_));
    state.read(as_span(low_));
  }

private:
  /// high + δ = sum + error exactly (Knuth), the error added to the low part.
  void two_sum(const Vector& delta) {
    sum_ = high_ + delta;
    part_ = sum_ - high_;
    low_ += (high_ - (sum_ - part_)) + (delta - part_);
  }
  void renormalise() {
    high_ = sum_ + low_;
    low_ -= high_ - sum_;
  }

  Vector high_, low_, sum_, part_;
};

/// The velocities δ/h at the midpoints of the last steps, extrapolated (Lagrange, at most cubic) to the middle of the
/// coming one.
template <typename Vector>
class VelocityHistory {
public:
  VelocityHistory() = default;
  explicit VelocityHistory(Eigen::Index size) : largest_(Vector::Zero(size)) {
    for (Sample& sample : samples_) {
      sample.velocity.setZero(size);
    }
  }

  [[nodiscard]] bool empty() const { return known_ == 0; }

  void record(double h, const Vector& delta) {
    Sample oldest = std::move(samples_.back());
    std::move_backward(samples_.begin(), samples_.end() - 1, samples_.end());
    oldest.time = time_ + 0.5 * h;
    oldest.velocity = delta / h;
    samples_.front() = std::move(oldest);
    known_ = std::min(known_ + 1, samples_.size());
    largest_ = largest_.cwiseMax(delta.cwiseAbs());
    time_ += h;
  }

  void predict(double h, Vector& delta) const {
    const double at = time_ + 0.5 * h;
    delta.setZero();
    for (std::size_t i = 0; i < known_; ++i) {
      delta += lagrange_weight(
                   i, known_, at, [&](std::size_t j) { return samples_[j].time; }, h) *
               samples_[i].velocity;
    }
  }

  /// max_i |v_i| / max(|δ_i|, largest |δ_i| so far, ε|z_i|, |v_i|), no more than 1: components of different magnitude
  /// weigh the same, and one that is 0 has no unit but v. NaN if any is.
  template <typename V, typename Delta>
  [[nodiscard]] double relative_size(const V& v, const Delta& delta, const Vector& z) const {
    double result = 0.0;
    for (Eigen::Index i = 0; i < v.size(); ++i) {
      const double size = std::abs(v[i]);
      const double scale =
          std::max({std::abs(delta[i]), largest_[i], std::numeric_limits<double>::epsilon() * std::abs(z[i]), size});
      const double ratio = size == 0.0 ? 0.0 : size / scale;
      result = larger(result, ratio);
    }
    return result;
  }

  void save(StateWriter& state) const {
    state.write(time_);
    state.write(static_cast<double>(known_));
    state.write(as_span(largest_));
    for (const Sample& sample : samples_) {
      state.write(sample.time);
      state.write(as_span(sample.velocity));
    }
  }
  void restore(StateReader& state) {
    state.read(time_);
    state.read(known_);
    state.read(as_span(largest_));
    for (Sample& sample : samples_) {
      state.read(sample.time);
      state.read(as_span(sample.velocity));
    }
  }

private:
  struct Sample {
    double time = 0.0;
    Vector velocity;
  };
  double time_ = 0.0;  ///< since the start
  std::array<Sample, 4> samples_;
  std::size_t known_ = 0;
  Vector largest_;
};

/// Judges the corrections of a contracting iteration: it is done when a correction is small enough or, within the
/// region where rounding rules, when corrections no longer shrink. A few ε of the increment are always rounding; more
/// than that may be, or it may be that the iteration contracts badly: the caller has to find out which.
class StagnationTest {
public:
  enum class Verdict {
    done,
    again,
    slow,     ///< they shrink too slowly: take another matrix
    stalled,  ///< they no longer shrink, or shrink without mending, at a size that rounding may explain or not
  };

  /// \param accuracy relative size of the last correction at which to stop; 0 asks for stagnation
  /// \param contraction seen before with the same matrix, infinite if none was: for iterations that contract steadily,
  ///        of which what the next correction would mend is known to be nothing before it is made
  /// \param before with the same matrix: the size of what one contraction made of the error that there is to begin
  ///        with; infinite where the matrix is new
  explicit StagnationTest(double accuracy, std::optional<double> contraction = std::nullopt,
                          double before = std::numeric_limits<double>::infinity())
      : accuracy_(std::max(accuracy, 0.5 * std::numeric_limits<double>::epsilon())),
        to_stagnation_(accuracy == 0.0),
        contraction_(contraction),
        size_(before) {}

  /// \param size of the correction, relative
  /// \param residual that it was made from, relative
  Verdict judge(double size, double residual) {
    const bool first = std::isinf(residual_);
    const bool smaller = first || size < 0.5 * size_;
    const bool slow = !first && size > poor_contraction * size_;
    // A matrix from where H changes very fast makes every residual look small: corrections shrink, and what they are to
    // mend does not.
    const bool mended = !smaller || std::isinf(size_) || residual < 0.5 * residual_;
    if (contraction_ && !std::isinf(size_) && size_ > certain_rounding) {
      const double seen = std::max(size / size_, residual / residual_);
      // Of a correction that may be rounding the ratio is only a bound, which does not make a known one worse.
      const bool is_bound = std::isinf(*contraction_) || size <= certain_rounding;
      contraction_ = is_bound ? std::min(seen, *contraction_) : std::max(seen, *contraction_);
    }
    size_ = size;
    residual_ = residual;
    // Newton's iteration with a new matrix squares what it starts from; where that is not all there is to a contraction
    // a loose answer is none the worse for it.
    if (!to_stagnation_ && contraction_ && size * std::min(*contraction_, size) <= accuracy_) {
      return Verdict::done;
    }
    if (to_stagnation_ && contraction_ && *contraction_ < poor_contraction &&
        *contraction_ * std::max(size, residual) <= leftover) {
      return Verdict::done;
    }
    if (size <= accuracy_ || (!smaller && size <= certain_rounding)) {
      const bool certain = residual <= std::max(accuracy_, certain_rounding) || !to_stagnation_;
      return certain ? Verdict::done : Verdict::stalled;
    }
    if (size < rounding_region) {
      return smaller && mended ? Verdict::again : Verdict::stalled;
    }
    return slow ? Verdict::slow : Verdict::again;
  }

  /// Of the corrections and of what they mend, the worst seen; infinite where fewer than two were.
  [[nodiscard]] std::optional<double> contraction() const { return contraction_; }

private:
  /// What the next correction may mend where it is not made, relative.
  static constexpr double leftover = 1e-3 * std::numeric_limits<double>::epsilon();
  /// Relative size of a correction that is nothing but rounding if no smaller one follows.
  static constexpr double certain_rounding = 16.0 * std::numeric_limits<double>::epsilon();
  /// Relative size of a correction below which no further shrinking may be due to rounding.
  static constexpr double rounding_region = 1e-8;
  /// A correction that shrinks less than this asks for a new matrix.
  static constexpr double poor_contraction = 0.1;
  double accuracy_;
  bool to_stagnation_;
  std::optional<double> contraction_;
  double size_ = std::numeric_limits<double>::infinity(), residual_ = std::numeric_limits<double>::infinity();
};

}  // namespace rubato
