#include <rubato/pde/cell_solver.hpp>

#include <algorithm>
#include <array>
#include <complex>

#include <Eigen/LU>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/solve/fourier_preconditioner.hpp>
#include <rubato/solve/gmres.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr int restart = 20;
/// Relative change of the constant-coefficient matrix beyond which the preconditioner is made anew.
constexpr double stale = 0.1;

class KrylovCellSolver final : public CellSolver {
public:
  KrylovCellSolver(const grids::Grid& grid, Placement placement, int size, double tolerance)
      : grid_(grid),
        size_(size),
        tolerance_(tolerance),
        blocks_(grid),
        gather_(grid),
        precondition_(grid, size),
        gmres_(static_cast<std::size_t>(size) * grid.size(), restart),
        rhs_(size, grid.size()),
        solution_(rhs_) {
    if (placement == Placement::nodes) {
      spectral_ = std::make_unique<grids::SpectralDerivative>(grid);
      derivative_.assign(static_cast<std::size_t>(grid.dimensions()), grids::FieldSet(size, grid.size()));
    }
  }

  Status solve(const CellMatrix& matrix, const KernelConditions& conditions, std::span<const double* const> rhs,
               std::span<double* const> solution, std::span<double> y) override {
    for (int r = 0; r < size_; ++r) {
      std::copy_n(rhs[static_cast<std::size_t>(r)], grid_.size(), rhs_.field(r).begin());
    }
    make_consistent(matrix, conditions, y);
    if (const Status status = prepare(matrix); status != Status::success) {
      return status;
    }
    solution_.fill(0.0);
    const auto apply = [&](const double* in, double* out) { multiply(matrix, in, out); };
    const auto outcome =
        gmres_.solve(apply, precondition_, rhs_.all(), solution_.all(),
                     {.tolerance = tolerance_, .acceptable = 100.0 * tolerance_, .max_iterations = 200});
    if (outcome.status != Status::success) {
      return outcome.status;
    }
    hold_means(matrix, conditions);
    for (int f = 0; f < size_; ++f) {
      std::ranges::copy(solution_.field(f), solution[static_cast<std::size_t>(f)]);
    }
    return Status::success;
  }

  void forget() override { prepared_mean_.resize(0, 0); }

private:
  /// Which lines of cells along x belong together: the kernel's vectors may differ between groups. With `free`
  /// directions y, z each combination of indices along them is a group.
  [[nodiscard]] std::size_t group_of(std::size_t line, const std::array<bool, 2>& free) const {
    const std::size_t j = line % grid_.cells(1);
    const std::size_t k = line / grid_.cells(1);
    return (free[0] ? j : 0) + (free[1] ? k * (free[0] ? grid_.cells(1) : 1) : 0);
  }

  [[nodiscard]] std::array<bool, 2> free_directions(const CellMatrix& matrix, const MatrixXd& vectors,
                                                    bool transposed) const {
    std::array<bool, 2> free{};
    for (int a = 1; a < grid_.dimensions(); ++a) {
      const MatrixXd& C = matrix.difference[static_cast<std::size_t>(a)];
      const MatrixXd product = transposed ? MatrixXd(C.transpose() * vectors) : MatrixXd(C * vectors);
      free[static_cast<std::size_t>(a) - 1] = product.isZero(1e-9);
    }
    return free;
  }

  /// means[b·lines + line] of Σ_r weights(r, b) values_r over the line's group.
  void group_means(const MatrixXd& weights, const grids::FieldSet& values, const std::array<bool, 2>& free,
                   std::vector<double>& means) const {
    const auto count = static_cast<std::size_t>(weights.cols());
    const std::size_t lines = blocks_.lines;
    means.assign(count * lines, 0.0);
    for (std::size_t b = 0; b < count; ++b) {
      std::vector<CompensatedSum> sums(lines);
      std::vector<std::size_t> members(lines, 0);
      for (std::size_t line = 0; line < lines; ++line) {
        const std::size_t group = group_of(line, free);
        members[group] += blocks_.line;
        for (int r = 0; r < size_; ++r) {
          const double weight = weights(r, static_cast<Index>(b));
          if (weight != 0.0) {
            const auto row = values.field(r).subspan(line * blocks_.line, blocks_.line);
            sums[group].add(weight * grids::sum(row));
          }
        }
      }
      for (std::size_t line = 0; line < lines; ++line) {
        const std::size_t group = group_of(line, free);
        means[b * lines + line] = sums[group].value() / static_cast<double>(members[group]);
      }
    }
  }

  /// rhs -= columns·vectors[line].
  void subtract(const MatrixXd& columns, std::span<const double> vectors, grids::FieldSet& values) const {
    for (Index b = 0; b < columns.cols(); ++b) {
      for (int r = 0; r < size_; ++r) {
        for (std::size_t line = 0; columns(r, b) != 0.0 && line < blocks_.lines; ++line) {
          const double change = columns(r, b) * vectors[static_cast<std::size_t>(b) * blocks_.lines + line];
          for (double& value : values.field(r).subspan(line * blocks_.line, blocks_.line)) {
            value -= change;
          }
        }
      }
    }
  }

  /// Solves leftᵀ(rhs - columns y) = 0 in the mean over every group of lines, and takes columns·y off the rhs.
  void make_consistent(const CellMatrix& matrix, const KernelConditions& conditions, std::span<double> y) {
    if (conditions.count() == 0) {
      return;
    }
    group_means(conditions.left, rhs_, free_directions(matrix, conditions.left, true), means_);
    const MatrixXd inverse = (conditions.left.transpose() * conditions.columns).inverse();
    mix(inverse, means_, y);
    subtract(conditions.columns, y, rhs_);
  }

  /// Adds kernel vectors so that the means of the pins are 0.
  void hold_means(const CellMatrix& matrix, const KernelConditions& conditions) {
    if (conditions.count() == 0) {
      return;
    }
    group_means(conditions.pins.transpose(), solution_, free_directions(matrix, conditions.kernel, false), means_);
    std::vector<double> amplitudes(means_.size());
    mix((conditions.pins * conditions.kernel).inverse(), means_, amplitudes);
    subtract(conditions.kernel, amplitudes, solution_);
  }

  /// out = matrix · in for each line.
  void mix(const MatrixXd& matrix, const std::vector<double>& in, std::span<double> out) const {
    for (std::size_t line = 0; line < blocks_.lines; ++line) {
      for (Index b = 0; b < matrix.rows(); ++b) {
        double sum = 0.0;
        for (Index c = 0; c < matrix.cols(); ++c) {
          sum += matrix(b, c) * in[static_cast<std::size_t>(c) * blocks_.lines + line];
        }
        out[static_cast<std::size_t>(b) * blocks_.lines + line] = sum;
      }
    }
  }

  Status prepare(const CellMatrix& matrix) {
    MatrixXd mean = matrix.mean;
    for (const CellMatrix::Entry& entry : matrix.entries) {
      mean(entry.row, entry.column) +=
          entry.factor * grids::sum({entry.values, grid_.size()}) / static_cast<double>(grid_.size());
    }
    if (!mean.allFinite()) {
      return Status::undefined;
    }
    if (prepared_mean_.size() > 0 && (mean - prepared_mean_).norm() <= stale * mean.norm()) {
      return Status::success;
    }
    prepared_mean_ = mean;
    return precondition_.factor([&](const std::array<std::ptrdiff_t, 3>& k, std::complex<double>* out) {
      std::array<std::complex<double>, 3> average{1.0, 1.0, 1.0};
      std::array<std::complex<double>, 3> difference{};
      for (int a = 0; a < grid_.dimensions(); ++a) {
        const auto i = static_cast<std::size_t>(a);
        if (spectral_ != nullptr) {
          difference[i] = grids::derivative_symbol(k[i], grid_.axis(a));
          continue;
        }
        const double theta = grids::wave_angle(k[i], grid_.cells(a));
        average[i] = grids::average_symbol(theta);
        difference[i] = grids::difference_symbol(theta, grid_.spacing(a));
      }
      const std::complex<double> all = average[0] * average[1] * average[2];
      for (int r = 0; r < size_; ++r) {
        for (int c = 0; c < size_; ++c) {
          out[r * size_ + c] = mean(r, c) * all;
        }
      }
      for (std::size_t a = 0; a < static_cast<std::size_t>(grid_.dimensions()); ++a) {
        const std::complex<double> symbol = difference[a] * average[(a + 1) % 3] * average[(a + 2) % 3];
        for (int r = 0; r < size_; ++r) {
          for (int c = 0; c < size_; ++c) {
            out[r * size_ + c] += matrix.difference[a](r, c) * symbol;
          }
        }
      }
    });
  }

  void multiply(const CellMatrix& matrix, const double* in, double* out) {
    const std::size_t n = grid_.size();
    for (std::size_t a = 0; a < derivative_.size(); ++a) {
      for (int f = 0; f < size_; ++f) {
        if (!matrix.difference[a].col(f).isZero(0.0)) {
          (*spectral_)(static_cast<int>(a), in + static_cast<std::size_t>(f) * n, derivative_[a].field(f).data());
        }
      }
    }
    grids::for_each_block(blocks_.count(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t block = first; block < last; ++block) {
        multiply_block(matrix, in, out, n, block);
      }
    });
  }

  void multiply_block(const CellMatrix& matrix, const double* in, double* out, std::size_t n, std::size_t block) const {
    const std::size_t line = block / blocks_.per_line;
    const std::size_t begin = block % blocks_.per_line * CellBlocks::most;
    const std::size_t count = std::min(CellBlocks::most, blocks_.line - begin);
    const std::size_t offset = line * blocks_.line + begin;
    double mean[CellBlocks::most];
    double difference[3][CellBlocks::most];
    double* const differences[3] = {difference[0], difference[1], difference[2]};
    for (int r = 0; r < size_; ++r) {
      std::fill_n(out + static_cast<std::size_t>(r) * n + offset, count, 0.0);
    }
    for (int f = 0; f < size_; ++f) {
      if (spectral_ == nullptr) {
        gather_(in + static_cast<std::size_t>(f) * n, line, begin, count, mean, differences);
      } else {
        std::copy_n(in + static_cast<std::size_t>(f) * n + offset, count, mean);
        for (std::size_t a = 0; a < derivative_.size(); ++a) {
          std::copy_n(derivative_[a].field(f).data() + offset, count, differences[a]);
        }
      }
      for (int r = 0; r < size_; ++r) {
        double* to = out + static_cast<std::size_t>(r) * n + offset;
        const auto add = [&](double factor, const double* values) {
          for (std::size_t c = 0; factor != 0.0 && c < count; ++c) {
            to[c] += factor * values[c];
          }
        };
        add(matrix.mean(r, f), mean);
        for (std::size_t a = 0; a < matrix.difference.size(); ++a) {
          add(matrix.difference[a](r, f), difference[a]);
        }
      }
      for (const CellMatrix::Entry& entry : matrix.entries) {
        if (entry.column == f) {
          double* to = out + static_cast<std::size_t>(entry.row) * n + offset;
          const double* values = entry.values + offset;
          for (std::size_t c = 0; c < count; ++c) {
            to[c] += entry.factor * values[c] * mean[c];
          }
        }
      }
    }
  }

  grids::Grid grid_;
  int size_;
  double tolerance_;
  CellBlocks blocks_;
  BoxGather gather_;
  solve::FourierPreconditioner precondition_;
  solve::Gmres gmres_;
  grids::FieldSet rhs_, solution_;
  std::unique_ptr<grids::SpectralDerivative> spectral_;  ///< at nodes only
  std::vector<grids::FieldSet> derivative_;              ///< along each axis
  MatrixXd prepared_mean_;
  std::vector<double> means_;
};

}  // namespace

std::unique_ptr<CellSolver> make_krylov_cell_solver(const grids::Grid& grid, Placement placement, int size,
                                                    double tolerance) {
  return std::make_unique<KrylovCellSolver>(grid, placement, size, tolerance);
}

std::unique_ptr<CellSolver> make_cell_solver(const grids::Grid& grid, Placement placement, int size, int conditions,
                                             double tolerance) {
  if (grid.dimensions() == 1 && placement == Placement::cells) {
    return make_cyclic_cell_solver(grid, size, conditions);
  }
  return make_krylov_cell_solver(grid, placement, size, tolerance);
}

}  // namespace rubato
