#include <rubato/ode/stage_newton.hpp>

#include <rubato/ode/tuning.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace rubato {

namespace {

using namespace tuning::stage_newton;

using Eigen::Index;

}  // namespace

std::optional<StageNewton> StageNewton::of(const GaussTableau& tableau, const Hamiltonian& hamiltonian) {
  const auto size = static_cast<Index>(2 * hamiltonian.degrees_of_freedom());
  std::optional<HessianBand> band = HessianBand::of(hamiltonian);
  if (!band && size > most_components) {
    return std::nullopt;
  }
  return StageNewton(tableau, size, std::move(band));
}

StageNewton::StageNewton(const GaussTableau& tableau, Index size, std::optional<HessianBand> band)
    : size_(size), band_(std::move(band)), units_(static_cast<std::size_t>(size)) {
  const GaussTableau::Eigenbasis& basis = tableau.inverse_eigenbasis();
  bool any_single = false;
  for (Index e = 0; e < basis.values.size(); ++e) {
    std::complex<double> value = basis.values[e];
    const bool single = std::abs(value.imag()) < real_to;
    if (!single && value.imag() < 0.0) {
      continue;  // its conjugate stands for both
    }
    any_single = any_single || single;
    // An eigenvector of a real eigenvalue is real but for a common factor of modulus 1.
    std::complex<double> turn = 1.0;
    if (single) {
      value = value.real();
      Index largest = 0;
      basis.V.col(e).cwiseAbs().maxCoeff(&largest);
      turn = basis.V(largest, e) / std::abs(basis.V(largest, e));
    }
    Part part{value, turn * value * basis.V_inverse.row(e).transpose(), (single ? 1.0 : 2.0) / turn * basis.V.col(e),
              solve::DenseSolver(1)};
    const int rows = static_cast<int>(single ? size : 2 * size);
    if (band_) {
      const int width = single ? band_->width : 2 * band_->width + 1;
      part.factors = solve::BandSolver(rows, std::min(width, rows - 1), std::min(width, rows - 1));
    } else {
      part.factors = solve::DenseSolver(rows);
    }
    parts_.push_back(std::move(part));
  }
  if (!band_) {
    gradient_.setZero(size);
    hessian_.setZero(size, size);
    matrix_.setZero(2 * size, 2 * size);
    if (any_single) {
      single_.setZero(size, size);
    }
  }
  rhs_.setZero(2 * size);
  result_.setZero(size, tableau.stages);
}

Status StageNewton::factor(HamiltonianEvaluator& hamiltonian, const double* point, double h) {
  std::span<const double> entries;
  if (band_) {
    entries = hamiltonian.hessian_entries(point);
  } else {
    hamiltonian.hessian(point, gradient_.data(), hessian_.data());
  }
  find_units(entries);
  for (Part& part : parts_) {
    if (const Status status = band_ ? factor_band(part, h, entries) : factor_whole(part, h);
        status != Status::success) {
      return status;
    }
  }
  return Status::success;
}

void StageNewton::find_units(std::span<const double> entries) {
  units_.begin(1.0);
  units_.find([&](const auto& use) {
    if (band_) {
      for (const auto& [row, column, number, sign] : band_->entries) {
        use(row, column, entries[number]);
      }
      return;
    }
    const Index n = size_ / 2;
    for (Index j = 0; j < size_; ++j) {
      for (Index i = 0; i < size_; ++i) {
        use(i, j, hessian_(i < n ? i + n : i - n, j));
      }
    }
  });
}

Status StageNewton::factor_whole(Part& part, double h) {
  const Index n = size_ / 2;
  const auto shifted = [&](auto block) {  // Re λ - h J H_zz
    block.topRows(n) = -h * hessian_.bottomRows(n);
    block.bottomRows(n) = h * hessian_.topRows(n);
    for (Index j = 0; units_.differ() && j < size_; ++j) {
      for (Index i = 0; i < size_; ++i) {
        block(i, j) *= units_.of_entry(static_cast<std::size_t>(i), static_cast<std::size_t>(j));
      }
    }
    block.diagonal().array() += part.value.real();
  };
  auto& factors = std::get<solve::DenseSolver>(part.factors);
  if (!part.is_pair()) {
    shifted(single_.topRows(size_));
    return factors.factor(single_.data());
  }
  shifted(matrix_.topLeftCorner(size_, size_));
  shifted(matrix_.bottomRightCorner(size_, size_));
  matrix_.topRightCorner(size_, size_).diagonal().setConstant(-part.value.imag());
  matrix_.bottomLeftCorner(size_, size_).diagonal().setConstant(part.value.imag());
  return factors.factor(matrix_.data());
}

Status StageNewton::factor_band(Part& part, double h, std::span<const double> entries) {
  auto& factors = std::get<solve::BandSolver>(part.factors);
  const int copies = part.is_pair() ? 2 : 1;  // a component's real and imaginary part stand side by side
  factors.clear();
  for (const auto& [row, column, number, sign] : band_->entries) {
    const double unit = units_.of_entry(static_cast<std::size_t>(row), static_cast<std::size_t>(column));
    for (int copy = 0; copy < copies; ++copy) {
      factors.entry(copies * row + copy, copies * column + copy) = -h * sign * entries[number] * unit;
    }
  }
  for (int i = 0; i < factors.size(); ++i) {
    factors.entry(i, i) += part.value.real();
  }
  if (part.is_pair()) {
    for (int i = 0; i < factors.size(); i += 2) {
      factors.entry(i, i + 1) = -part.value.imag();
      factors.entry(i + 1, i) = part.value.imag();
    }
  }
  return factors.factor();
}

Index StageNewton::place(const Part& part, Index r, bool imaginary) const {
  if (!band_) {
    return imaginary ? size_ + r : r;
  }
  const Index row = band_->places[static_cast<std::size_t>(r)];
  return part.is_pair() ? 2 * row + (imaginary ? 1 : 0) : row;
}

void StageNewton::solve(Rows& right) {
  result_.setZero();
  const Index m = result_.cols();
  for (Part& part : parts_) {
    rhs_.setZero();
    for (Index r = 0; r < size_; ++r) {
      const double unit = units_[unit_of(r)];
      double& real = rhs_[place(part, r, false)];
      for (Index i = 0; i < m; ++i) {
        real += part.from_stages[i].real() * right(r, i) / unit;
      }
      if (part.is_pair()) {
        double& imaginary = rhs_[place(part, r, true)];
        for (Index i = 0; i < m; ++i) {
          imaginary += part.from_stages[i].imag() * right(r, i) / unit;
        }
      }
    }
    std::visit([this](auto& factors) { factors.solve(rhs_.data()); }, part.factors);
    for (Index r = 0; r < size_; ++r) {
      const double unit = units_[unit_of(r)];
      const double real = rhs_[place(part, r, false)] * unit;
      const double imaginary = part.is_pair() ? rhs_[place(part, r, true)] * unit : 0.0;
      for (Index i = 0; i < m; ++i) {
        result_(r, i) += part.to_stages[i].real() * real;
        if (part.is_pair()) {
          result_(r, i) -= part.to_stages[i].imag() * imaginary;
        }
      }
    }
  }
  right.leftCols(m) = result_;
}

double StageNewton::factor_operations() const {
  double sum = 0.0;
  for (const Part& part : parts_) {
    if (const auto* band = std::get_if<solve::BandSolver>(&part.factors)) {
      sum += band_operation * 4.0 * band->size() * band->lower() * band->lower();
    } else {
      const double n = std::get<solve::DenseSolver>(part.factors).size();
      sum += 2.0 / 3.0 * n * n * n + 2.0 * n * n;
    }
  }
  return sum;
}

double StageNewton::solve_operations() const {
  double sum = 0.0;
  for (const Part& part : parts_) {
    if (const auto* band = std::get_if<solve::BandSolver>(&part.factors)) {
      sum += band_operation * 6.0 * band->size() * band->lower();
    } else {
      const double n = std::get<solve::DenseSolver>(part.factors).size();
      sum += 2.0 * n * n;
    }
    sum += 4.0 * static_cast<double>(result_.size());
  }
  return sum;
}

}  // namespace rubato
