#include <rubato/ode/stage_tangent.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <rubato/base/all_finite.hpp>
#include <rubato/base/larger.hpp>
#include <rubato/ode/tuning.hpp>

namespace rubato {

using Eigen::Index;
using Eigen::MatrixXd;

StageTangent::StageTangent(const Hamiltonian& hamiltonian, const GaussTableau& tableau)
    : tableau_(tableau),
      m_(static_cast<std::size_t>(tableau.stages)),
      lanes_(std::bit_ceil(m_)),
      size_(2 * hamiltonian.degrees_of_freedom()),
      entry_count_(hamiltonian.hessian_places().size()) {
  const std::size_t n = size_ / 2;
  const auto add = [&](std::size_t row, std::size_t column, std::size_t entry) {
    const bool of_momentum = row < n;  // the rate of p_row is -∂H/∂q_row
    terms_[of_momentum ? 1 : 0].push_back({of_momentum ? row + n : row - n, column, entry, of_momentum ? -1.0 : 1.0});
  };
  for (std::size_t entry = 0; entry < entry_count_; ++entry) {
    const auto [row, column] = hamiltonian.hessian_places()[entry];
    add(row, column, entry);
    if (row != column) {
      add(column, row, entry);
    }
  }
}

Status StageTangent::operator()(HamiltonianEvaluator& hamiltonian, const Stages& Z, double h,
                                std::span<double> columns) {
  count_ = columns.size() / size_;
  const std::size_t block = size_ * count_;
  start_.resize(block);
  V_.resize(lanes_ * block);
  F_.resize(lanes_ * block);
  entries_.assign(lanes_ * entry_count_, 0.0);
  point_.resize(size_);
  for (std::size_t i = 0; i < m_; ++i) {
    for (std::size_t row = 0; row < size_; ++row) {
      point_[row] = Z(static_cast<Index>(row), static_cast<Index>(i));
    }
    const std::span<const double> entries = hamiltonian.hessian_entries(point_.data());
    for (std::size_t k = 0; k < entry_count_; ++k) {
      entries_[k * lanes_ + i] = entries[k];
    }
  }
  for (std::size_t row = 0; row < size_; ++row) {
    for (std::size_t c = 0; c < count_; ++c) {
      start_[row * count_ + c] = columns[c * size_ + row];
      std::fill_n(V_.begin() + static_cast<std::ptrdiff_t>(place(row, c, 0)), lanes_, columns[c * size_ + row]);
    }
  }
  if (!all_finite(entries_)) {
    return Status::undefined;
  }
  static_assert(GaussTableau::most_stages == 8);
  const bool iterated = lanes_ == 1   ? iterate<1>(h)
                        : lanes_ == 2 ? iterate<2>(h)
                        : lanes_ == 4 ? iterate<4>(h)
                                      : iterate<8>(h);
  if (!iterated) {
    if (const Status status = solve(h); status != Status::success) {
      return status;
    }
  }
  for (std::size_t row = 0; row < size_; ++row) {
    for (std::size_t c = 0; c < count_; ++c) {
      double sum = 0.0;
      for (std::size_t i = 0; i < m_; ++i) {
        sum += tableau_.b[static_cast<Index>(i)] * F_[place(row, c, i)];
      }
      columns[c * size_ + row] += h * sum;
    }
  }
  return all_finite(columns) ? Status::success : Status::undefined;
}

/// The rates of q, or of p, which begin in this row, of all stages.
template <std::size_t M>
void StageTangent::multiply(const std::vector<Term>& terms, std::size_t first_row) {
  const std::size_t row_length = count_ * M;
  std::fill_n(F_.begin() + static_cast<std::ptrdiff_t>(first_row * row_length), size_ / 2 * row_length, 0.0);
  for (const Term& term : terms) {
    std::array<double, M> factors;
    for (std::size_t i = 0; i < M; ++i) {
      factors[i] = term.sign * entries_[term.entry * M + i];
    }
    const double* V = V_.data() + term.from * row_length;
    double* F = F_.data() + term.to * row_length;
    for (std::size_t c = 0; c < count_; ++c, V += M, F += M) {
      for (std::size_t i = 0; i < M; ++i) {
        F[i] += factors[i] * V[i];
      }
    }
  }
}

/// \return whether it contracted, and went on to stagnation
template <std::size_t M>
bool StageTangent::iterate(double h) {
  using namespace tuning::stage_tangent;
  std::array<double, M * M> weights{};
  for (std::size_t i = 0; i < m_; ++i) {
    for (std::size_t j = 0; j < m_; ++j) {
      weights[j * M + i] = h * tableau_.a(static_cast<Index>(i), static_cast<Index>(j));
    }
  }
  const std::size_t half = size_ / 2;
  double last = std::numeric_limits<double>::infinity();
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    std::array<double, M> changes{}, sizes{};
    for (const std::size_t which : {1, 0}) {
      multiply<M>(terms_[which], which * half);
      const double* F = F_.data() + which * half * count_ * M;
      double* V = V_.data() + which * half * count_ * M;
      const double* start = start_.data() + which * half * count_;
      for (std::size_t k = 0; k < half * count_; ++k, F += M, V += M, ++start) {
        std::array<double, M> next;
        next.fill(*start);
        for (std::size_t j = 0; j < M; ++j) {
          for (std::size_t i = 0; i < M; ++i) {
            next[i] += weights[j * M + i] * F[j];
          }
        }
        for (std::size_t i = 0; i < M; ++i) {
          const double moved = std::abs(next[i] - V[i]);
          changes[i] = moved <= changes[i] ? changes[i] : moved;  // what is not a number stays
          sizes[i] = std::abs(next[i]) > sizes[i] ? std::abs(next[i]) : sizes[i];
          V[i] = next[i];
        }
      }
    }
    double change = 0.0, size = 0.0;
    for (std::size_t i = 0; i < M; ++i) {
      change = larger(change, changes[i]);
      size = std::max(size, sizes[i]);
    }
    if (!std::isfinite(change) || (sweep > 1 && change > slowest * last && change > stagnation * size)) {
      return false;
    }
    // What the next sweep would mend is beneath rounding; F is that of V_i to within it.
    const bool steady = sweep > 1 && change < slowest * last;
    if (change <= 0.5 * std::numeric_limits<double>::epsilon() * size ||
        (change <= stagnation * size && change >= slowest * last) ||
        (steady && change * change <= beneath * last * size)) {
      return true;
    }
    last = change;
  }
  return false;
}

/// (δ_ij - h a_ij JH_zz(Z_j)) V_j = V_0, all at once.
Status StageTangent::solve(double h) {
  constexpr std::size_t largest = 4096;  // of a dense matrix
  const std::size_t all = m_ * size_;
  if (all > largest) {
    return Status::not_converged;
  }
  MatrixXd matrix = MatrixXd::Identity(static_cast<Index>(all), static_cast<Index>(all));
  for (std::size_t j = 0; j < m_; ++j) {
    for (const auto& terms : terms_) {
      for (const Term& term : terms) {
        for (std::size_t i = 0; i < m_; ++i) {
          matrix(static_cast<Index>(i * size_ + term.to), static_cast<Index>(j * size_ + term.from)) -=
              h * tableau_.a(static_cast<Index>(i), static_cast<Index>(j)) * term.sign *
              entries_[term.entry * lanes_ + j];
        }
      }
    }
  }
  if (!factors_) {
    factors_.emplace(static_cast<int>(all));
  }
  if (const Status status = factors_->factor(matrix.data()); status != Status::success) {
    return status;
  }
  std::vector<double> stages(all * count_);
  for (std::size_t c = 0; c < count_; ++c) {
    for (std::size_t i = 0; i < all; ++i) {
      stages[c * all + i] = start_[i % size_ * count_ + c];
    }
  }
  factors_->solve(stages.data(), static_cast<int>(count_));
  std::ranges::fill(F_, 0.0);
  for (const auto& terms : terms_) {
    for (const Term& term : terms) {
      for (std::size_t c = 0; c < count_; ++c) {
        for (std::size_t i = 0; i < m_; ++i) {
          F_[place(term.to, c, i)] +=
              term.sign * entries_[term.entry * lanes_ + i] * stages[c * all + i * size_ + term.from];
        }
      }
    }
  }
  return Status::success;
}

}  // namespace rubato
