#include <rubato/ode/stationary_action.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <rubato/formula/rounding.hpp>

namespace rubato {

namespace {

/// Of the duration of the guess: shorter orbits are no solutions, for what an energy leaves falls with the duration.
constexpr double least_duration = 1e-3;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

using Entries = std::vector<Eigen::Triplet<double>>;

}  // namespace

double NodesOfOrbit::duration() const {
  return std::accumulate(h.begin(), h.end(), 0.0);
}

double energy_scale(const Hamiltonian& hamiltonian, const NodesOfOrbit& orbit) {
  formula::SumSizeEvaluator size(hamiltonian.size_code());
  double largest = 0.0;
  for (std::size_t k = 0; k <= orbit.segments(); ++k) {
    const double terms = size(orbit.node(k)).terms;
    largest = std::isfinite(terms) ? std::max(largest, terms) : largest;
  }
  return largest > 0.0 ? largest : 1.0;
}

StationaryAction::StationaryAction(const Hamiltonian& hamiltonian, SegmentEquation& segments, const EndConditions& ends,
                                   Targets targets, const NodesOfOrbit& guess, Levels levels,
                                   const StepPotential& potential)
    : hamiltonian_(hamiltonian),
      segments_(segments),
      ends_(ends.with_constraints(hamiltonian)),
      targets_(targets),
      levels_(levels),
      potential_(potential),
      ratios_(guess.h),
      scales_(VectorXd::Zero(static_cast<Index>(guess.dimension))),
      row_scales_(scales_),
      energy_scale_(energy_scale(hamiltonian, guess)) {
  duration_scale_ = guess.duration();
  step_scale_ = duration_scale_ / static_cast<double>(guess.segments());
  for (double& ratio : ratios_) {
    ratio /= step_scale_;
  }
  for (std::size_t i = 0; i < guess.z.size(); ++i) {
    double& scale = scales_[static_cast<Index>(i % guess.dimension)];
    scale = std::max(scale, std::abs(guess.z[i]));
  }
  const Index n = size() / 2;
  for (Index i = 0; i < n; ++i) {
    // A pair of which one number vanishes everywhere has no scale of its own.
    double &q = scales_[i], &p = scales_[n + i];
    q = q > 0.0 ? q : 1.0;
    p = p > 0.0 ? p : 1.0;
  }
  row_scales_ << scales_.tail(n), scales_.head(n);  // the row of q_i is that of a change of p_i
  VectorXd values;
  MatrixXd by_0, by_N;
  ends_.evaluate(guess.node(0), guess.node(guess.segments()), values, by_0, by_N);
  const VectorXd terms = (by_0.cwiseAbs() + by_N.cwiseAbs()) * scales_;
  end_scales_ = terms.unaryExpr([](double term) { return std::isfinite(term) && term > 0.0 ? term : 1.0; });
}

VectorXd StationaryAction::pack(const NodesOfOrbit& orbit) {
  VectorXd u = VectorXd::Zero(unknowns());
  for (Index k = 0; k <= steps(); ++k) {
    const std::span<const double> z = orbit.node(static_cast<std::size_t>(k));
    u.segment(k * size(), size()) = Eigen::Map<const VectorXd>(z.data(), size()).cwiseQuotient(scales_);
  }
  Status status = Status::success;
  const bool defined = linearise(orbit, status);
  double time = 0.0, sum = 0.0;
  for (Index k = 0; k < steps(); ++k) {
    const auto place = static_cast<std::size_t>(k);
    const double h = orbit.h[place];
    u[level_place(k)] = h / step_scale_;
    time += h;
    sum += defined ? h * linearised_[place].energy : 0.0;
    if (has_time()) {
      u[time_place(k + 1)] = time / duration_scale_;
    }
    if (has_energy()) {
      u[sum_place(k + 1)] = sum / (duration_scale_ * energy_scale_);
    }
  }
  if (has_parameter()) {
    u[parameter_place()] =
        targets_.parameter == Parameter::duration ? time / duration_scale_ : sum / (time * energy_scale_);
  }
  return u;
}

NodesOfOrbit StationaryAction::unpack(const VectorXd& u) const {
  NodesOfOrbit orbit{.dimension = static_cast<std::size_t>(size()), .z = {}, .h = {}};
  orbit.z.resize(static_cast<std::size_t>(size() * (steps() + 1)));
  for (Index k = 0; k <= steps(); ++k) {
    Eigen::Map<VectorXd>(orbit.z.data() + k * size(), size()) = u.segment(k * size(), size()).cwiseProduct(scales_);
  }
  for (Index k = 0; k < steps(); ++k) {
    orbit.h.push_back(u[level_place(k)] * step_scale_);
  }
  return orbit;
}

/// Rows under construction.
struct StationaryAction::Rows {
  VectorXd& residual;
  bool with_jacobian;
  Entries entries = {};

  void add(Index row, Index column, double value) {
    if (with_jacobian) {
      entries.emplace_back(row, column, value);
    }
  }
  /// Of a block whose rows and columns have scales.
  template <typename Block>
  void add_block(Index row, Index column, const Block& block, const VectorXd& rows, const VectorXd& columns) {
    for (Index i = 0; with_jacobian && i < block.rows(); ++i) {
      for (Index j = 0; j < block.cols(); ++j) {
        add(row + i, column + j, block(i, j) / rows[i] * columns[j]);
      }
    }
  }
};

/// Evaluates all segments. False where one is not defined: failed_; or where the orbit is far shorter than the guess:
/// at no duration every place is an orbit of every energy.
bool StationaryAction::linearise(const NodesOfOrbit& orbit, Status& status) {
  linearised_.resize(orbit.segments());
  for (std::size_t k = 0; k < orbit.segments(); ++k) {
    // A level before the one that it follows is a reflected root (theory, section 3).
    status = orbit.h[k] * step_scale_ > 0.0
                 ? segments_.evaluate(orbit.node(k), orbit.node(k + 1), orbit.h[k], linearised_[k])
                 : Status::singular;
    if (status != Status::success) {
      failed_ = k;
      return false;
    }
  }
  if (!(orbit.duration() / duration_scale_ > least_duration)) {
    status = Status::singular;
    failed_ = 0;
    return false;
  }
  return true;
}

Status StationaryAction::evaluate(const VectorXd& u, VectorXd& residual, Eigen::SparseMatrix<double>* jacobian,
                                  std::span<const LinearCondition> further) {
  const NodesOfOrbit orbit = unpack(u);
  Status status = Status::success;
  if (!linearise(orbit, status)) {
    return status;
  }
  residual.setZero(this->rows() + static_cast<Index>(further.size()));
  Rows rows{residual, jacobian != nullptr};
  for (Index k = 0; k < steps(); ++k) {
    add_values(k, rows);
  }
  add_levels(orbit, rows);
  add_sums(orbit, u, rows);
  if (!add_ends(orbit, rows)) {
    failed_ = 0;
    return Status::undefined;
  }
  add_targets(u, rows);
  Index row = this->rows();
  for (const LinearCondition& condition : further) {
    residual[row] = condition.coefficients.dot(u) - condition.value;
    for (Eigen::SparseVector<double>::InnerIterator entry(condition.coefficients); entry; ++entry) {
      rows.add(row, entry.index(), entry.value());
    }
    ++row;
  }
  if (jacobian != nullptr) {
    jacobian->resize(residual.size(), unknowns());
    jacobian->setFromTriplets(rows.entries.begin(), rows.entries.end());
  }
  return residual.allFinite() ? Status::success : Status::undefined;
}

/// The value equations that segment k has a part in.
void StationaryAction::add_values(Index k, Rows& rows) const {
  const SegmentRows& segment = linearised_[static_cast<std::size_t>(k)];
  const auto add = [&](Index row, Index first) {
    rows.residual.segment(row, size()) += segment.value.segment(first, size()).cwiseQuotient(row_scales_);
    rows.add_block(row, k * size(), segment.by_0.middleRows(first, size()), row_scales_, scales_);
    rows.add_block(row, (k + 1) * size(), segment.by_1.middleRows(first, size()), row_scales_, scales_);
    for (Index i = 0; i < size(); ++i) {
      rows.add(row + i, level_place(k), segment.by_h[first + i] / row_scales_[i] * step_scale_);
    }
  };
  if (!segments_.is_action()) {
    add(k * size(), 0);
    return;
  }
  if (k > 0) {
    add((k - 1) * size(), 0);
  }
  if (k + 1 < steps()) {
    add(k * size(), size());
  }
}

/// factor dK_k + by_h dh_k.
void StationaryAction::add_energy(Index k, Index row, double factor, double by_h, Rows& rows) const {
  const SegmentRows& segment = linearised_[static_cast<std::size_t>(k)];
  for (Index j = 0; j < size(); ++j) {
    rows.add(row, k * size() + j, factor * segment.energy_by_0[j] * scales_[j] / energy_scale_);
    rows.add(row, (k + 1) * size() + j, factor * segment.energy_by_1[j] * scales_[j] / energy_scale_);
  }
  rows.add(row, level_place(k), (factor * segment.energy_by_h + by_h) * step_scale_ / energy_scale_);
}

/// From each step to the next.
void StationaryAction::add_levels(const NodesOfOrbit& orbit, Rows& rows) const {
  for (Index k = 1; k < steps(); ++k) {
    const Index row = value_rows() + k - 1;
    const auto place = static_cast<std::size_t>(k);
    if (!free()) {
      const double before = step_scale_ * ratios_[place - 1], after = step_scale_ * ratios_[place];
      rows.residual[row] = orbit.h[place] / after - orbit.h[place - 1] / before;
      rows.add(row, level_place(k), step_scale_ / after);
      rows.add(row, level_place(k - 1), -step_scale_ / before);
      continue;
    }
    const StepPotential::Part before = potential_.at(orbit.h[place - 1]), after = potential_.at(orbit.h[place]);
    rows.residual[row] =
        (linearised_[place].energy - linearised_[place - 1].energy + (after.energy - before.energy)) / energy_scale_;
    add_energy(k, row, 1.0, after.slope, rows);
    add_energy(k - 1, row, -1.0, -before.slope, rows);
  }
}

/// The running sums of h, and of h K.
void StationaryAction::add_sums(const NodesOfOrbit& orbit, const VectorXd& u, Rows& rows) const {
  for (Index k = 0; k < steps() && has_time(); ++k) {
    const auto place = static_cast<std::size_t>(k);
    const double h = orbit.h[place];
    const auto add = [&](Index row, Index last, Index next, double increment) {
      rows.residual[row] = u[next] - (k == 0 ? 0.0 : u[last]) - increment;
      rows.add(row, next, 1.0);
      if (k > 0) {
        rows.add(row, last, -1.0);
      }
    };
    add(time_row() + k, time_place(k), time_place(k + 1), h / duration_scale_);
    rows.add(time_row() + k, level_place(k), -step_scale_ / duration_scale_);
    if (has_energy()) {
      const double energy = linearised_[place].energy;
      add(sum_row() + k, sum_place(k), sum_place(k + 1), h * energy / (duration_scale_ * energy_scale_));
      add_energy(k, sum_row() + k, -h / duration_scale_, -energy / duration_scale_, rows);
    }
  }
}

void StationaryAction::add_targets(const VectorXd& u, Rows& rows) const {
  Index row = target_row();
  const Index last = steps();
  if (has_duration_row()) {
    const bool is_parameter = targets_.parameter == Parameter::duration;
    rows.residual[row] =
        u[time_place(last)] - (is_parameter ? u[parameter_place()] : *targets_.duration / duration_scale_);
    rows.add(row, time_place(last), 1.0);
    if (is_parameter) {
      rows.add(row, parameter_place(), -1.0);
    }
    ++row;
  }
  if (has_energy()) {
    const bool is_parameter = targets_.parameter == Parameter::energy;
    const double energy = is_parameter ? u[parameter_place()] : *targets_.energy / energy_scale_;
    rows.residual[row] = u[sum_place(last)] - energy * u[time_place(last)];
    rows.add(row, sum_place(last), 1.0);
    rows.add(row, time_place(last), -energy);
    if (is_parameter) {
      rows.add(row, parameter_place(), -u[time_place(last)]);
    }
  }
}

/// False where a condition is not defined.
bool StationaryAction::add_ends(const NodesOfOrbit& orbit, Rows& rows) {
  const Index row = end_row();
  VectorXd values;
  MatrixXd by_0, by_N;
  ends_.evaluate(orbit.node(0), orbit.node(orbit.segments()), values, by_0, by_N);
  if (!values.allFinite() || !by_0.allFinite() || !by_N.allFinite()) {
    return false;
  }
  rows.residual.segment(row, values.size()) = values.cwiseQuotient(end_scales_);
  rows.add_block(row, 0, by_0, end_scales_, scales_);
  rows.add_block(row, steps() * size(), by_N, end_scales_, scales_);
  return true;
}

Eigen::SparseVector<double> StationaryAction::parameter_form() const {
  Eigen::SparseVector<double> form(unknowns());
  form.insert(parameter_place()) = targets_.parameter == Parameter::duration ? duration_scale_ : energy_scale_;
  return form;
}

Eigen::SparseVector<double> StationaryAction::start_form(std::size_t i) const {
  Eigen::SparseVector<double> form(unknowns());
  form.insert(static_cast<Index>(i)) = scales_[static_cast<Index>(i)];
  return form;
}

std::string StationaryAction::describe(Index row) const {
  const Index n = size() / 2;
  if (row < value_rows()) {
    const Index component = row % size();
    const std::string& name = component < n ? hamiltonian_.q_names()[static_cast<std::size_t>(component)]
                                            : hamiltonian_.p_names()[static_cast<std::size_t>(component - n)];
    return segments_.is_action() ? fmt::format("the Euler-Lagrange equation of level {}, in {}", row / size() + 1, name)
                                 : fmt::format("the step from level {}, in the equation of {}", row / size(), name);
  }
  if (row < time_row()) {
    return fmt::format("{} at level {}", free() ? "the energy law" : "the ratio of steps", row - value_rows() + 1);
  }
  if (row < end_row()) {
    return row < sum_row() ? "the sum of the steps" : "the sum of the energies";
  }
  if (row < target_row()) {
    return fmt::format("the end condition {}", ends_.text(static_cast<std::size_t>(row - end_row())));
  }
  if (row < rows()) {
    return has_duration_row() && row == target_row() ? "the duration" : "the energy";
  }
  return "the condition of the continuation";
}

}  // namespace rubato
