#include <rubato/ode/orbit_between.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <rubato/base/all_finite.hpp>

namespace rubato {

OrbitBetween::OrbitBetween(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian, bool starting_pair,
                           std::span<const double> z_0)
    : map_(method_of(lagrangian).scheme != nullptr
               ? make_one_step_scheme(hamiltonian.without_constant(), lagrangian, z_0)
               : nullptr),
      hamiltonian_(hamiltonian),
      has_parasite_(starting_pair),
      whole_(z_0.size()),
      first_(z_0.size()),
      last_(z_0.size()) {}

OrbitBetween::OrbitBetween(std::unique_ptr<OneStepScheme> map, std::size_t dimension)
    : map_(std::move(map)), has_parasite_(false), whole_(dimension) {}

Status OrbitBetween::at(std::span<const double> z_k, std::span<const double> z_next, double h, double fraction,
                        std::span<double> out) {
  Status status = Status::success;
  if (fraction == 0.0 || fraction == 1.0) {
    std::ranges::copy(fraction == 0.0 ? z_k : z_next, out.begin());
  } else if (map_ == nullptr) {
    status = hermite(z_k, z_next, h, fraction, out);
  } else {
    status = step(z_k, fraction * h, out);
    if (status == Status::success && has_parasite_) {
      status = step(z_k, h, whole_);
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] += fraction * (z_next[i] - whole_[i]);
      }
    }
  }
  const bool finite = all_finite(out);
  if (status != Status::success || !finite) {
    std::ranges::fill(out, std::numeric_limits<double>::quiet_NaN());
    return status == Status::success ? Status::undefined : status;
  }
  return Status::success;
}

void OrbitBetween::save(StateWriter& state) const {
  if (map_ != nullptr) {
    map_->save_guesses(state);
  }
}

void OrbitBetween::restore(StateReader& state) {
  if (map_ != nullptr) {
    map_->restore_guesses(state);
  }
}

Status OrbitBetween::step(std::span<const double> z, double h, std::span<double> out) {
  map_->restart(z);
  Status status = map_->advance(h, 0.0);
  if (status != Status::success) {  // where it cannot be solved from nothing, from a step of half the length
    map_->restart(z);
    status = map_->advance(0.5 * h, 0.0);
    status = status == Status::success ? map_->advance(h, 0.0) : status;
  }
  if (status == Status::success) {
    map_->accept();
    std::ranges::copy(map_->state(), out.begin());
  }
  return status;
}

Status OrbitBetween::hermite(std::span<const double> z_k, std::span<const double> z_next, double h, double fraction,
                             std::span<double> out) {
  const std::size_t n = out.size() / 2;
  hamiltonian_->gradient(z_k.data(), first_.data());
  hamiltonian_->gradient(z_next.data(), last_.data());
  const double rest = 1.0 - fraction;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double sign = i < n ? 1.0 : -1.0;
    const std::size_t partner = i < n ? i + n : i - n;
    const double delta = z_next[i] - z_k[i];
    const double from = h * sign * first_[partner] - delta, to = h * sign * last_[partner] - delta;
    out[i] = z_k[i] + fraction * (delta + rest * (rest * from - fraction * to));
  }
  return Status::success;
}

}  // namespace rubato
