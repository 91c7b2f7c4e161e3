#include <rubato/ode/sensitivities.hpp>

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace rubato {

Sensitivities::Sensitivities(const Extend& extend, const SegmentLagrangian& lagrangian, std::span<const double> z_0,
                             std::vector<double> values)
    : values_(std::move(values)), n_(z_0.size() / 2), derivatives_(values_.size() * z_0.size(), 0.0) {
  const auto make = [&](bool as_momenta) {
    as_momenta_ = as_momenta;
    this->extend(z_0, begin_);
    tangent_ = make_orbit_tangent(extend(as_momenta), lagrangian, false, begin_);
  };
  try {
    make(false);
  } catch (const std::invalid_argument&) {
    make(true);
  }
  const std::size_t size = begin_.size(), all = size / 2;
  columns_.assign(values_.size() * size, 0.0);
  for (std::size_t i = 0; i < values_.size(); ++i) {
    columns_[i * size + (as_momenta_ ? all : 0) + n_ + i] = 1.0;
  }
}

/// (q, λ, p, 0), or (q, 0, p, λ).
void Sensitivities::extend(std::span<const double> z, std::vector<double>& to) const {
  const std::size_t all = n_ + values_.size();
  to.assign(2 * all, 0.0);
  std::ranges::copy(z.first(n_), to.begin());
  std::ranges::copy(z.last(n_), to.begin() + static_cast<std::ptrdiff_t>(all));
  std::ranges::copy(values_, to.begin() + static_cast<std::ptrdiff_t>((as_momenta_ ? all : 0) + n_));
}

Status Sensitivities::step(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h) {
  extend(z_0, begin_);
  extend(z_1, end_);
  const Status status = tangent_->step(begin_, end_, t_0, h, columns_);
  if (status != Status::success) {
    std::ranges::fill(columns_, std::numeric_limits<double>::quiet_NaN());
  }
  read();
  return status;
}

void Sensitivities::read() {
  const std::size_t size = begin_.size(), all = size / 2;
  for (std::size_t i = 0; i < values_.size(); ++i) {
    for (std::size_t j = 0; j < n_; ++j) {
      derivatives_[i * 2 * n_ + j] = columns_[i * size + j];
      derivatives_[i * 2 * n_ + n_ + j] = columns_[i * size + all + j];
    }
  }
}

void Sensitivities::save(StateWriter& state) const {
  state.write(columns_);
  tangent_->save(state);
}

void Sensitivities::restore(StateReader& state) {
  state.read(std::span<double>(columns_));
  tangent_->restore(state);
  read();
}

}  // namespace rubato
