#include <rubato/ode/generating_function.hpp>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/taylor.hpp>
#include <rubato/ode/generating_nodes.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/taylor_code.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Σ_{j=first..last} weight(j)·coefficient(j)·h^(j-first) by Horner's rule.
template <typename Coefficient>
auto horner(double h, int first, int last, Coefficient coefficient) {
  auto sum = coefficient(last);
  for (int j = last - 1; j >= first; --j) {
    sum = coefficient(j) + h * sum;
  }
  return sum;
}

}  // namespace

/// Centres and gradients, for a field alone or with tangent vectors: then everything consists of two blocks of 2n
/// numbers, the second of which is the derivative of the first along the tangent vector.
class GeneratingFunction::Expansion {
public:
  Expansion(const formula::Bytecode& field, const MatrixXd& F, int terms)
      : half_(F.rows() / 2),
        rows_(static_cast<Index>(field.input_count())),
        plain_(F.isZero(0.0)),
        half_twist_(plain_ ? MatrixXd() : MatrixXd(0.5 * turned(F))),
        nodes_(terms, plain_),
        field_(field, terms - 1, nodes_.count),
        antiderivative_{{field_, as_span(nodes_.antiderivative[0])}, {field_, as_span(nodes_.antiderivative[1])}},
        jump_(VectorXd::Zero(rows_)),
        shift_(jump_),
        centres_(MatrixXd::Zero(rows_, terms + 1)),
        centre_slopes_(centres_),
        gradients_(MatrixXd::Zero(rows_, terms + 1)) {}

  void start(std::span<const double> w) {
    field_.restart();
    for (std::size_t m = 0; m < w.size(); ++m) {
      std::ranges::fill(field_.input(m, 0), w[m]);
    }
    centres_.col(0) = Eigen::Map<const VectorXd>(w.data(), rows_);
    known_ = 0;
  }

  Status extend(int terms) {
    for (; known_ < terms; ++known_) {
      if (known_ > 0) {
        feed_back();
      }
      if (const Status status = field_.advance(); status != Status::success) {
        return status;
      }
      take_term();
    }
    return Status::success;
  }

  [[nodiscard]] bool plain() const { return plain_; }
  [[nodiscard]] int known() const { return known_; }
  [[nodiscard]] std::span<const double> centre(int d) const { return column(centres_, d); }
  [[nodiscard]] const MatrixXd& gradients() const { return gradients_; }
  /// Of t^d in H(c(t)), 1 ≤ d ≤ known(), by its derivative ∇H(c)·c' = (J∇H(c))ᵀJc', for a field alone.
  [[nodiscard]] double energy(int d) const {
    double sum = 0.0;
    for (int k = stride(); k <= d; k += stride()) {
      const auto slope = centre_slopes_.col(d - k);
      const auto centre = centres_.col(k);
      sum += k * (slope.head(half_).dot(centre.tail(half_)) - slope.tail(half_).dot(centre.head(half_)));
    }
    return sum / d;
  }
  /// Between the powers of t in c(t).
  [[nodiscard]] int stride() const { return plain_ ? 2 : 1; }
  [[nodiscard]] std::span<const double> gradient(int j) const { return column(gradients_, j); }
  [[nodiscard]] const GeneratingNodes& nodes() const { return nodes_; }
  [[nodiscard]] std::span<const double> slopes(std::size_t m) const { return field_.output_lanes(m); }
  [[nodiscard]] Index slope_stride() const { return static_cast<Index>(field_.lane_stride()); }
  [[nodiscard]] std::string failure() const { return field_.failure(); }

private:
  [[nodiscard]] static std::span<const double> column(const MatrixXd& matrix, int j) {
    return {matrix.col(j).data(), static_cast<std::size_t>(matrix.rows())};
  }
  [[nodiscard]] auto slope(Index m) const {
    const std::span<const double> lanes = field_.output(static_cast<std::size_t>(m), known_);
    return Eigen::Map<const VectorXd>(lanes.data(), nodes_.count);
  }

  /// y_d at the nodes from f(y)_{d-1}.
  void feed_back() {
    field_.feed_back(antiderivative_[(known_ - 1) % 2]);
    if (!plain_) {
      for (Index m = 0; m < rows_; ++m) {
        for (double& value : field_.input(static_cast<std::size_t>(m), known_)) {
          value -= shift_[m];
        }
      }
    }
  }

  /// From f(y)_d: the coefficients of t^(d+1) in ẑ - z, hence in ∇φ, and in c = y(0).
  void take_term() {
    const Index next = known_ + 1;
    const bool has_centre = !plain_ || known_ % 2 == 1;
    const bool has_jump = !plain_ || known_ % 2 == 0;
    if (has_jump) {
      for (Index m = 0; m < rows_; ++m) {
        jump_[m] = nodes_.integral.dot(slope(m));
        centre_slopes_(m, known_) = nodes_.centre_value.dot(slope(m));
      }
      for (Index block = 0; block < rows_; block += 2 * half_) {
        gradients_.col(next).segment(block, half_) = jump_.segment(block + half_, half_);
        gradients_.col(next).segment(block + half_, half_) = -jump_.segment(block, half_);
        if (!plain_) {
          shift_.segment(block, 2 * half_).noalias() = half_twist_ * jump_.segment(block, 2 * half_);
        }
      }
    }
    if (has_centre) {
      for (Index m = 0; m < rows_; ++m) {
        centres_(m, next) = nodes_.centre_integral[known_ % 2].dot(slope(m)) - shift_[m];
      }
    }
  }

  Index half_, rows_;
  bool plain_;           ///< F = 0: the even terms of ∇φ and the odd ones of c vanish
  MatrixXd half_twist_;  ///< ½JF, unless it vanishes
  GeneratingNodes nodes_;
  formula::TaylorEvaluator field_;  ///< a lane for each node
  formula::TaylorEvaluator::LaneMap antiderivative_[2];
  VectorXd jump_, shift_;                         ///< coefficients in ẑ - z, in ½JF(ẑ - z)
  MatrixXd centres_, centre_slopes_, gradients_;  ///< column d: of t^d in c, in J∇H(c) and in ∇φ
  int known_ = 0;                                 ///< highest term
};

struct GeneratingFunction::State {
  State(const Hamiltonian& h, const MatrixXd& matrix, int count)
      : hamiltonian(h),
        F(matrix),
        terms(count),
        expansion(flow_code(h), matrix, count),
        energy(h),
        phi(static_cast<std::size_t>(count) + 2, 0.0) {}

  Hamiltonian hamiltonian;
  MatrixXd F;
  int terms;
  Expansion expansion;
  HamiltonianEvaluator energy;
  int known_values = 0;  ///< the φ^j known are those with j up to this
  std::vector<double> phi;
  std::unique_ptr<Expansion> tangent;  ///< made when first needed
  bool tangent_failed = false;
  std::string energy_failure;  ///< why H itself has no expansion, if it has none
};

GeneratingFunction::GeneratingFunction(const Hamiltonian& hamiltonian, const MatrixXd& F, int terms) {
  check_darboux_symmetric(F, static_cast<Index>(hamiltonian.degrees_of_freedom()));
  if (terms < 1 || terms > most_terms) {
    throw std::invalid_argument(
        fmt::format("a generating function needs between 1 and {} terms; got {}", most_terms, terms));
  }
  state_ = std::make_unique<State>(hamiltonian, F, terms);
}

GeneratingFunction::GeneratingFunction(GeneratingFunction&&) noexcept = default;
GeneratingFunction& GeneratingFunction::operator=(GeneratingFunction&&) noexcept = default;
GeneratingFunction::~GeneratingFunction() = default;

int GeneratingFunction::terms() const {
  return state_->terms;
}
std::size_t GeneratingFunction::dimension() const {
  return static_cast<std::size_t>(state_->F.rows());
}
const MatrixXd& GeneratingFunction::F() const {
  return state_->F;
}
bool GeneratingFunction::odd() const {
  return state_->expansion.plain();
}

Status GeneratingFunction::expand(std::span<const double> w) {
  const Status status = expand_gradients(w, state_->terms);
  return status == Status::success ? expand_values() : status;
}

Status GeneratingFunction::expand_gradients(std::span<const double> w, int terms) {
  assert(w.size() == dimension());
  state_->known_values = 0;
  state_->energy_failure.clear();
  state_->tangent_failed = false;
  state_->expansion.start(w);
  return extend_gradients(terms);
}

Status GeneratingFunction::extend_gradients(int terms) {
  assert(terms <= state_->terms);
  const Status status = state_->expansion.extend(terms);
  if (status != Status::success) {
    probe_energy();
  }
  return status;
}

/// The user wrote H, not its gradient: whether H itself fails along some line through w decides how a failure is
/// reported.
void GeneratingFunction::probe_energy() {
  formula::TaylorEvaluator energy(energy_code(state_->hamiltonian), 1);
  const std::span<const double> w = state_->expansion.centre(0);
  for (std::size_t m = 0; m < w.size(); ++m) {
    energy.input(m)[0] = w[m];
    energy.input(m)[1] = 1.0 + std::sqrt(2.0 + static_cast<double>(m));  // a direction along no symmetry
  }
  state_->energy_failure = energy() == Status::success ? "" : energy.failure();
}

Status GeneratingFunction::expand_values() {
  State& state = *state_;
  const int stride = state.expansion.stride();
  if (state.known_values == 0) {
    state.phi[1] = -state.energy.value(state.expansion.centre(0).data());
    state.known_values = 1;
    if (!std::isfinite(state.phi[1])) {
      probe_energy();
      return Status::undefined;
    }
  }
  for (int d = state.known_values - 1 + stride; d <= state.expansion.known(); d += stride) {
    state.phi[static_cast<std::size_t>(d) + 1] = -state.expansion.energy(d) / (d + 1);
    state.known_values = d + 1;
  }
  return Status::success;
}

double GeneratingFunction::coefficient(int j) const {
  assert(j >= 1 && j <= state_->terms + 1);
  return state_->phi[static_cast<std::size_t>(j)];
}
std::span<const double> GeneratingFunction::gradient(int j) const {
  assert(j >= 1 && j <= state_->terms);
  return state_->expansion.gradient(j);
}
std::span<const double> GeneratingFunction::centre(int d) const {
  assert(d >= 0 && d <= state_->terms);
  return state_->expansion.centre(d);
}

int GeneratingFunction::known_terms() const {
  return state_->expansion.known();
}
const GeneratingNodes& GeneratingFunction::nodes() const {
  return state_->expansion.nodes();
}
std::span<const double> GeneratingFunction::slopes(std::size_t m) const {
  return state_->expansion.slopes(m);
}
Index GeneratingFunction::slope_stride() const {
  return state_->expansion.slope_stride();
}

double GeneratingFunction::sum(double h, int s) const {
  return h * horner(h, 1, s, [&](int j) { return coefficient(j); });
}
double GeneratingFunction::sum_rate(double h, int s) const {
  return horner(h, 1, s, [&](int j) { return j * coefficient(j); });
}
double GeneratingFunction::sum_second_rate(double h, int s) const {
  return s < 2 ? 0.0 : horner(h, 2, s, [&](int j) { return j * (j - 1) * coefficient(j); });
}

double GeneratingFunction::rate_rounding(double h, int s) const {
  double rest = 0.0;
  for (int j = s; j >= 2; --j) {
    rest = std::abs(h) * (j * std::abs(coefficient(j)) + rest);
  }
  // φ^j comes from some j products of series that were rounded themselves.
  return s * std::numeric_limits<double>::epsilon() * rest;
}

void GeneratingFunction::gradient_sum(double h, int s, Eigen::Ref<VectorXd> result) const {
  const MatrixXd& gradients = state_->expansion.gradients();
  result = gradients.col(s);
  for (int j = s - 1; j >= 1; --j) {
    result = gradients.col(j) + h * result;
  }
  result *= h;
}

void GeneratingFunction::gradient_sum_rate(double h, int s, Eigen::Ref<VectorXd> result) const {
  const MatrixXd& gradients = state_->expansion.gradients();
  result = s * gradients.col(s);
  for (int j = s - 1; j >= 1; --j) {
    result = j * gradients.col(j) + h * result;
  }
}

Status GeneratingFunction::hessian_sum(std::span<const double> w, double h, int s, Eigen::Ref<MatrixXd> result) {
  State& state = *state_;
  if (!state.tangent) {
    state.tangent = std::make_unique<Expansion>(tangent_flow_code(state.hamiltonian), state.F, state.terms);
  }
  const std::size_t size = dimension();
  std::vector<double> point(w.begin(), w.end());
  point.resize(2 * size, 0.0);
  const auto rows = static_cast<Index>(size);
  for (std::size_t i = 0; i < size; ++i) {
    point[size + i] = 1.0;
    state.tangent->start(point);
    const Status status = state.tangent->extend(s);
    point[size + i] = 0.0;
    state.tangent_failed = status != Status::success;
    if (status != Status::success) {
      return status;
    }
    const auto tangents = state.tangent->gradients().bottomRows(rows);
    VectorXd column = tangents.col(s);
    for (int j = s - 1; j >= 1; --j) {
      column = tangents.col(j) + h * column;
    }
    result.col(static_cast<Index>(i)) = h * column;
  }
  result = (0.5 * (result + result.transpose())).eval();  // symmetric to rounding already
  return Status::success;
}

std::string GeneratingFunction::failure() const {
  return state_->tangent_failed            ? state_->tangent->failure()
         : !state_->energy_failure.empty() ? state_->energy_failure
                                           : state_->expansion.failure();
}

}  // namespace rubato
