#include <rubato/variation/extrapolation.hpp>

#include <algorithm>
#include <cmath>
#include <type_traits>

#include <rubato/variation/tuning.hpp>

namespace rubato {

using namespace tuning;

/// Newton's form: f[0] + (t - t_0) f[0, 1] + (t - t_0)(t - t_1) f[0, 1, 2] + …, newest value first.
double Extrapolation::at(double ahead) {
  double factor = 1.0, sum = 0.0;
  for (std::size_t degree = 0; degree < known_; ++degree) {
    sum += factor * differences_[degree];
    foreseen_[degree] = sum;
    factor *= ahead + distances_[degree];
  }
  foreseen_count_ = known_;
  foreseen_ahead_ = ahead;
  return foreseen_[best_];
}

void Extrapolation::add(double ahead, double value) {
  const std::size_t judged = ahead == foreseen_ahead_ ? foreseen_count_ : 0;
  for (std::size_t degree = 0; degree < judged; ++degree) {
    const double error = std::abs(foreseen_[degree] - value);
    errors_[degree] = std::isfinite(errors_[degree]) ? memory * errors_[degree] + error : error / (1.0 - memory);
  }
  foreseen_count_ = 0;
  best_ = 0;
  double least = errors_[0];  // kept as a number: looked up anew, each comparison would wait for the one before
  for (std::size_t degree = 1; degree < most; ++degree) {
    best_ = errors_[degree] < least ? degree : best_;
    least = std::min(least, errors_[degree]);
  }
  known_ = std::min(known_ + 1, most);
  if (known_ == most) {
    take_in(std::integral_constant<std::size_t, most>(), ahead, value);
  } else {
    take_in(known_, ahead, value);
  }
}

/// The value becomes the newest of `count`, which the compiler may know.
template <typename Count>
void Extrapolation::take_in(Count count, double ahead, double value) {
  const std::size_t known = count;
  // Of the values before, and quotients that do not wait for each other.
  std::array<double, most> inverse{};
  for (std::size_t j = known - 1; j > 0; --j) {
    distances_[j] = distances_[j - 1] + ahead;
  }
  for (std::size_t j = 1; j < known; ++j) {
    inverse[j] = 1.0 / distances_[j];
  }
  // f[0, …, j+1] = (f[0, …, j] - f[1, …, j+1])/(t_0 - t_{j+1})
  double newer = value;
  for (std::size_t j = 0; j + 1 < known; ++j) {
    const double older = differences_[j];
    differences_[j] = newer;
    newer = (newer - older) * inverse[j + 1];
  }
  differences_[known - 1] = newer;
}

void Extrapolation::save(StateWriter& state) const {
  state.write(static_cast<double>(known_));
  state.write(static_cast<double>(best_));
  state.write(std::span<const double>(distances_));
  state.write(std::span<const double>(differences_));
  state.write(std::span<const double>(errors_));
}

void Extrapolation::restore(StateReader& state) {
  state.read(known_);
  state.read(best_);
  state.read(std::span<double>(distances_));
  state.read(std::span<double>(differences_));
  state.read(std::span<double>(errors_));
  foreseen_count_ = 0;
}

}  // namespace rubato
