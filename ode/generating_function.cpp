#include <rubato/ode/generating_function.hpp>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/taylor.hpp>
#include <rubato/ode/taylor_code.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A family of flows Z(s; c(t)) of either parity, with Z(±t/2; c(t)) split into its even and odd part.
class SplitFlow {
public:
  virtual ~SplitFlow() = default;
  virtual void restart() = 0;
  virtual Status extend(std::span<const double> coefficient) = 0;
  /// The coefficients of t^d in Ev - c and in Od.
  virtual void split(int d, double* even, double* odd) const = 0;
  [[nodiscard]] virtual std::string failure() const = 0;
};

template <typename Grading>
class GradedSplitFlow final : public SplitFlow {
public:
  GradedSplitFlow(const formula::Bytecode& field, int order) : family_(field, order) {}

  void restart() override { family_.restart(); }
  Status extend(std::span<const double> coefficient) override { return family_.extend(coefficient); }
  [[nodiscard]] std::string failure() const override { return family_.failure(); }

  void split(int d, double* even, double* odd) const override {
    for (std::size_t m = 0; m < family_.dimension(); ++m) {
      const std::span<const double> part = family_.part(m, d);
      double sums[2] = {0.0, 0.0};
      // From the highest power of t, whose factor 2^-i is the largest; s^0 is c itself.
      for (int i = static_cast<int>(part.size()) - 1; i >= 0; --i) {
        const int power = d - Grading::stride * i;
        if (power > 0) {
          sums[power % 2] += std::ldexp(part[static_cast<std::size_t>(i)], -power);
        }
      }
      even[m] = sums[0];
      odd[m] = sums[1];
    }
  }

private:
  formula::BasicTaylorFlowFamily<Grading> family_;
};

std::unique_ptr<SplitFlow> make_flow(const formula::Bytecode& field, int order, bool even_in_t) {
  if (even_in_t) {
    return std::make_unique<GradedSplitFlow<formula::EvenBivariate>>(field, order);
  }
  return std::make_unique<GradedSplitFlow<formula::Bivariate>>(field, order);
}

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
        twist_(symplectic_unit(half_) * F),
        flow_(make_flow(field, terms, plain_)),
        even_(VectorXd::Zero(rows_)),
        odd_(even_),
        centres_(MatrixXd::Zero(rows_, terms + 1)),
        gradients_(MatrixXd::Zero(rows_, terms + 1)) {}

  void start(std::span<const double> w) {
    flow_->restart();
    centres_.col(0) = Eigen::Map<const VectorXd>(w.data(), rows_);
    known_ = 0;
  }

  Status extend(int terms) {
    for (; known_ < terms; ++known_) {
      if (const Status status = flow_->extend(column(centres_, known_)); status != Status::success) {
        return status;
      }
      const Index next = known_ + 1;
      flow_->split(known_ + 1, even_.data(), odd_.data());
      auto centre = centres_.col(next);
      centre = -even_;
      for (Index block = 0; block < rows_; block += 2 * half_) {
        if (!plain_) {
          centre.segment(block, 2 * half_).noalias() -= twist_ * odd_.segment(block, 2 * half_);
        }
        gradients_.col(next).segment(block, half_) = 2.0 * odd_.segment(block + half_, half_);
        gradients_.col(next).segment(block + half_, half_) = -2.0 * odd_.segment(block, half_);
      }
      if (plain_ && next % 2 == 1) {
        centre.setZero();  // instead of -0
      }
    }
    return Status::success;
  }

  [[nodiscard]] bool plain() const { return plain_; }
  [[nodiscard]] int known() const { return known_; }
  [[nodiscard]] std::span<const double> centre(int d) const { return column(centres_, d); }
  [[nodiscard]] const MatrixXd& gradients() const { return gradients_; }
  [[nodiscard]] std::span<const double> gradient(int j) const { return column(gradients_, j); }
  [[nodiscard]] std::string failure() const { return flow_->failure(); }

private:
  [[nodiscard]] static std::span<const double> column(const MatrixXd& matrix, int j) {
    return {matrix.col(j).data(), static_cast<std::size_t>(matrix.rows())};
  }

  Index half_, rows_;
  bool plain_;      ///< F = 0
  MatrixXd twist_;  ///< JF
  std::unique_ptr<SplitFlow> flow_;
  VectorXd even_, odd_;
  MatrixXd centres_, gradients_;  ///< column d: of t^d
  int known_ = 0;                 ///< highest term
};

struct GeneratingFunction::State {
  State(const Hamiltonian& h, const MatrixXd& matrix, int count)
      : hamiltonian(h),
        F(matrix),
        terms(count),
        expansion(flow_code(h), matrix, count),
        stride(expansion.plain() ? 2 : 1),
        energy(energy_code(h), std::max(1, count / stride)),
        phi(static_cast<std::size_t>(count) + 2, 0.0) {}

  Hamiltonian hamiltonian;
  MatrixXd F;
  int terms;
  Expansion expansion;
  int stride;                       ///< between the powers of t in c(t)
  formula::TaylorEvaluator energy;  ///< H(c(t)) as a series in t^stride
  std::vector<double> phi;
  std::unique_ptr<Expansion> tangent;  ///< made when first needed
  bool energy_failed = false, tangent_failed = false;
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
  state_->energy.restart();
  state_->energy_failed = state_->tangent_failed = false;
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

/// The user wrote H, not its gradient: whether H itself fails along some line through w decides how a failure is told.
void GeneratingFunction::probe_energy() {
  formula::TaylorEvaluator& energy = state_->energy;
  const std::span<const double> w = state_->expansion.centre(0);
  for (std::size_t m = 0; m < w.size(); ++m) {
    std::ranges::fill(energy.input(m), 0.0);
    energy.input(m)[0] = w[m];
    energy.input(m)[1] = 1.0 + std::sqrt(2.0 + static_cast<double>(m));  // a direction along no symmetry
  }
  state_->energy_failed = energy() != Status::success;
}

Status GeneratingFunction::expand_values() {
  formula::TaylorEvaluator& energy = state_->energy;
  const int stride = state_->stride;
  for (int i = energy.next_order(); i * stride <= state_->expansion.known(); ++i) {
    const std::span<const double> centre = state_->expansion.centre(i * stride);
    for (std::size_t m = 0; m < centre.size(); ++m) {
      energy.input(m, i)[0] = centre[m];
    }
    if (const Status status = energy.advance(); status != Status::success) {
      state_->energy_failed = true;
      return status;
    }
    const int j = i * stride + 1;
    state_->phi[static_cast<std::size_t>(j)] = -energy.output(0, i)[0] / j;
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

double GeneratingFunction::sum(double h, int s) const {
  return h * horner(h, 1, s, [&](int j) { return coefficient(j); });
}
double GeneratingFunction::sum_rate(double h, int s) const {
  return horner(h, 1, s, [&](int j) { return j * coefficient(j); });
}
double GeneratingFunction::sum_second_rate(double h, int s) const {
  return s < 2 ? 0.0 : horner(h, 2, s, [&](int j) { return j * (j - 1) * coefficient(j); });
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
  return state_->tangent_failed  ? state_->tangent->failure()
         : state_->energy_failed ? state_->energy.failure()
                                 : state_->expansion.failure();
}

}  // namespace rubato
