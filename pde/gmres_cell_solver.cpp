#include <rubato/pde/cell_solver.hpp>

#include <algorithm>
#include <array>
#include <complex>
#include <functional>
#include <limits>
#include <numeric>
#include <utility>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/box_gather.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/pde/still_waves.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/fourier_preconditioner.hpp>
#include <rubato/solve/gmres.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::krylov;

using Eigen::Index;
using Eigen::MatrixXd;

/// A⁻¹; not finite where A is singular, for the residual to show.
MatrixXd inverse_of(const MatrixXd& A) {
  const MatrixXd identity = MatrixXd::Identity(A.rows(), A.rows());
  return solve::quotient(A, identity).value_or(identity * std::numeric_limits<double>::infinity());
}

/// With C the matrix whose entries are their means, inverted block by block in Fourier space, and V the entries less
/// their means, the system (C + V A) c = r is one for w, those fields of c that V multiplies, alone:
///
///     c = C⁻¹(r - V A w),      w = (C⁻¹ r)_w - (C⁻¹ V A w)_w,
///
/// a second-kind equation with a small operator. c has the error of w, made smaller by that operator once more.
class GmresCellSolver final : public CellSolver {
public:
  GmresCellSolver(const grids::Grid& grid, Collocation collocation, int size, double tolerance)
      : grid_(grid),
        whole_(grids::whole_of(grid)),
        collocation_(collocation),
        size_(size),
        tolerance_(tolerance),
        blocks_(grid),
        gather_(grid),
        inverse_(grid, size),
        all_(static_cast<std::size_t>(size)),
        reads_ghosts_(collocation == Collocation::cells && grids::Slab::of(grid) != nullptr) {
    std::iota(all_.begin(), all_.end(), 0);
    if (collocation == Collocation::nodes) {
      spectral_ = std::make_unique<grids::SpectralDerivative>(grid);
    }
    if (collocation.has_elements()) {
      elements_ = std::make_unique<ElementOperators>(grid, collocation.stages);
    }
    for (int a = 0; a < grid.dimensions(); ++a) {
      find_symbols(a);
    }
  }

  Status solve(const CellMatrix& matrix, const KernelConditions& conditions, std::span<const double* const> rhs,
               std::span<double* const> solution, std::span<double> y) override {
    std::span<const double* const> right = rhs;
    if (conditions.count() > 0 || elements_ != nullptr) {
      if (rhs_.fields() == 0) {
        rhs_ = grids::FieldSet(size_, grid_.size());
      }
      for (int r = 0; r < size_; ++r) {
        std::ranges::copy(std::span(rhs[static_cast<std::size_t>(r)], grid_.size()), rhs_.field(r).begin());
      }
      to_rows(rhs_, size_);
      make_consistent(matrix, conditions, y);
      right = std::as_const(rhs_).pointers();
    }
    if (const Status status = prepare(matrix); status != Status::success) {
      return status;
    }
    Status status = solve_once(right, solution, tolerance_);
    if (status == Status::success && check_) {
      status = refine(matrix, right, solution);
    }
    if (status == Status::success) {
      hold_means(matrix, conditions, solution);
    }
    return status;
  }

  void forget() override {
    is_prepared_ = false;
    spread_ = 0.0;
  }
  void check_residuals(bool on) override { check_ = on; }
  void set_tolerance(double tolerance) override { tolerance_ = tolerance; }
  [[nodiscard]] double error() const override { return error_; }

private:
  /// A and D/A along an axis: from ẑ of the nodes to the rows.
  void find_symbols(int a) {
    const grids::Axis& axis = whole_.axis(a);
    std::vector<std::complex<double>>& averages = averages_.emplace_back(axis.cells);
    std::vector<double>& slopes = slopes_.emplace_back(axis.cells);
    for (std::size_t w = 0; w < axis.cells; ++w) {
      const bool is_negative = 2 * w > axis.cells;
      const std::size_t place = is_negative ? axis.cells - w : w;
      const double sign = is_negative ? -1.0 : 1.0;
      if (elements_ != nullptr && 2 * w == axis.cells) {
        continue;  // a wave that no row sees
      }
      if (elements_ != nullptr) {
        averages[w] = elements_->space().factor().re.field(0)[place];
        slopes[w] = sign * elements_->space().derivatives()[0][place];
      } else if (collocation_ == Collocation::nodes) {
        averages[w] = 1.0;
        slopes[w] = sign * grids::derivative_symbol(static_cast<std::ptrdiff_t>(place), axis).imag();
      } else {
        const double theta = sign * grids::wave_angle(static_cast<std::ptrdiff_t>(place), axis.cells);
        averages[w] = grids::average_symbol(theta);
        slopes[w] = 2.0 * std::tan(0.5 * theta) / axis.spacing();
      }
    }
  }

  /// The waves on which the kernel's vectors are to be looked for, and the lines along x over which they are one.
  [[nodiscard]] StillWaves still_waves(const CellMatrix& matrix, const MatrixXd& vectors, bool transposed) const {
    std::array<bool, 2> free{};
    for (int a = 1; a < grid_.dimensions(); ++a) {
      const MatrixXd& C = matrix.difference[static_cast<std::size_t>(a)];
      free[static_cast<std::size_t>(a) - 1] =
          solve::annihilates((transposed ? MatrixXd(C.transpose()) : C).cast<std::complex<double>>(),
                             vectors.cast<std::complex<double>>());
    }
    return {grid_, collocation_, free};
  }

  [[nodiscard]] double line_sum(unsigned pattern, const double* row) const {
    if (!StillWaves::alternates_along_x(pattern)) {
      const grids::Slab::Shared alone(nullptr);  // of a line, not of a lattice
      return grids::sum({row, blocks_.line});
    }
    CompensatedSum sum;
    for (std::size_t i = 0; i < blocks_.line; ++i) {
      sum.add(i % 2 == 0 ? row[i] : -row[i]);
    }
    return sum.value();
  }

  /// means[b·lines + line] of Σ_r weights(r, b) values_r times the wave over the line's group.
  void group_means(const MatrixXd& weights, std::span<double* const> values, const StillWaves& waves, unsigned pattern,
                   std::vector<double>& means) const {
    const auto count = static_cast<std::size_t>(weights.cols());
    const std::size_t lines = blocks_.lines;
    means.assign(count * lines, 0.0);
    std::vector<double> totals(lines);
    for (std::size_t b = 0; b < count; ++b) {
      std::vector<CompensatedSum> sums(lines);
      for (std::size_t line = 0; line < lines; ++line) {
        const std::size_t group = waves.group_of(line);
        const double sign = waves.sign_of(pattern, line);
        for (int r = 0; waves.owns(line) && r < size_; ++r) {
          const double weight = sign * weights(r, static_cast<Index>(b));
          if (weight != 0.0) {
            sums[group].add(weight * line_sum(pattern, values[static_cast<std::size_t>(r)] + line * blocks_.line));
          }
        }
      }
      std::ranges::transform(sums, totals.begin(), [](const CompensatedSum& sum) { return sum.value(); });
      waves.add_ranks(totals, 1);
      for (std::size_t line = 0; line < lines; ++line) {
        means[b * lines + line] = totals[waves.group_of(line)] / static_cast<double>(waves.members());
      }
    }
  }

  /// rhs -= columns·vectors[line] times the wave.
  void subtract(const MatrixXd& columns, std::span<const double> vectors, const StillWaves& waves, unsigned pattern,
                std::span<double* const> values) const {
    const double next = StillWaves::alternates_along_x(pattern) ? -1.0 : 1.0;
    for (Index b = 0; b < columns.cols(); ++b) {
      for (int r = 0; r < size_; ++r) {
        for (std::size_t line = 0; columns(r, b) != 0.0 && line < blocks_.lines; ++line) {
          double change = waves.sign_of(pattern, line) * columns(r, b) *
                          vectors[static_cast<std::size_t>(b) * blocks_.lines + line];
          double* row = values[static_cast<std::size_t>(r)] + line * blocks_.line;
          for (double& value : std::span(row, blocks_.line)) {
            value -= change;
            change *= next;
          }
        }
      }
    }
  }

  /// Solves leftᵀ(rhs - columns y) = 0 in the mean over every group of lines, and takes columns·y off the rhs; the same
  /// on sawtooths, whose amplitudes no one else needs to know.
  void make_consistent(const CellMatrix& matrix, const KernelConditions& conditions, std::span<double> y) {
    if (conditions.count() == 0) {
      return;
    }
    const MatrixXd inverse = inverse_of(solve::product(conditions.left.transpose(), conditions.columns));
    const StillWaves waves = still_waves(matrix, conditions.left, true);
    std::vector<double> amplitudes(y.size());
    for (const unsigned pattern : waves.patterns()) {
      group_means(conditions.left, rhs_.pointers(), waves, pattern, means_);
      const std::span<double> out = pattern == 0 ? y : std::span<double>(amplitudes);
      mix(inverse, means_, out);
      subtract(conditions.columns, out, waves, pattern, rhs_.pointers());
    }
  }

  /// Adds kernel vectors so that the means of the pins, and their sawtooths, are 0.
  void hold_means(const CellMatrix& matrix, const KernelConditions& conditions, std::span<double* const> solution) {
    if (conditions.count() == 0) {
      return;
    }
    const MatrixXd inverse = inverse_of(solve::product(conditions.pins, conditions.kernel));
    const StillWaves waves = still_waves(matrix, conditions.kernel, false);
    for (const unsigned pattern : waves.patterns()) {
      group_means(conditions.pins.transpose(), solution, waves, pattern, means_);
      std::vector<double> amplitudes(means_.size());
      mix(inverse, means_, amplitudes);
      subtract(conditions.kernel, amplitudes, waves, pattern, solution);
    }
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
    const bool anew = !is_prepared_ || (matrix.mean - prepared_).norm() > stale * prepared_.norm();
    if (anew) {
      prepared_ = matrix.mean;
      is_prepared_ = true;
      means_of_entries_.clear();
      inverted_ = matrix.mean;
      sizes_ = matrix.mean.cwiseAbs();
      for (const CellMatrix::Entry& entry : matrix.entries) {
        means_of_entries_.push_back(grids::sum({entry.values, grid_.size()}) / static_cast<double>(whole_.size()));
        inverted_(entry.row, entry.column) += entry.factor * means_of_entries_.back();
        sizes_(entry.row, entry.column) += std::abs(entry.factor * means_of_entries_.back());
      }
      if (!inverted_.allFinite()) {
        is_prepared_ = false;
        return Status::undefined;
      }
    }
    find_variation(matrix);
    return anew ? factor(matrix) : Status::success;
  }

  /// What C leaves out: the entries less their means, and what the constants have changed since.
  void find_variation(const CellMatrix& matrix) {
    variation_.clear();
    rows_.clear();
    columns_.clear();
    const auto size = static_cast<std::size_t>(size_);
    variation_.reserve(matrix.entries.size() + size * size);
    rows_.reserve(size);
    columns_.reserve(size);
    const auto place_in = [](std::vector<int>& list, int value) {
      const auto found = std::ranges::find(list, value);
      const auto place = static_cast<std::size_t>(found - list.begin());
      if (found == list.end()) {
        list.push_back(value);
      }
      return place;
    };
    for (std::size_t e = 0; e < matrix.entries.size(); ++e) {
      const CellMatrix::Entry& entry = matrix.entries[e];
      variation_.push_back({place_in(rows_, entry.row), place_in(columns_, entry.column), entry.factor,
                            -entry.factor * means_of_entries_[e], entry.values});
    }
    for (int r = 0; r < size_; ++r) {
      for (int c = 0; c < size_; ++c) {
        if (const double change = matrix.mean(r, c) - prepared_(r, c); change != 0.0) {
          variation_.push_back({place_in(rows_, r), place_in(columns_, c), 0.0, change, nullptr});
        }
      }
    }
    const int columns = static_cast<int>(columns_.size());
    if (start_.fields() < columns) {
      start_ = grids::FieldSet(columns, grid_.size());
      means_at_points_ = elements_ != nullptr ? start_ : grids::FieldSet();
      with_ghosts_ = reads_ghosts_ ? start_ : grids::FieldSet();
    }
    if (products_.fields() < static_cast<int>(rows_.size())) {
      products_ = grids::FieldSet(static_cast<int>(rows_.size()), grid_.size());
    }
  }

  /// c of (C + V A) c = rhs, to the relative error `tolerance` if the operator is small, as far as GMRES comes else.
  Status solve_once(std::span<const double* const> rhs, std::span<double* const> solution, double tolerance) {
    error_ = 0.0;
    inverse_.take(rhs);
    if (variation_.empty()) {
      inverse_.solve_all({}, {}, solution);
      return Status::success;
    }
    inverse_.solve({}, {}, columns_, start_.pointers().first(columns_.size()));
    // w = (C⁻¹ r)_w is off by the operator's size, c then by its square.
    if (spread_ * spread_ <= tolerance) {
      finish(start_.all().data(), solution);
      error_ = spread_ * spread_;
      if (error_ <= tolerance) {
        return Status::success;
      }
      inverse_.take(rhs);
    }
    if (gmres_ == nullptr || gmres_->size() != columns_.size() * grid_.size()) {
      image_ = grids::FieldSet(static_cast<int>(columns_.size()), grid_.size());
      gmres_ = std::make_unique<solve::Gmres>(image_.all().size(), restart);
    }
    const std::span<double> w = image_.all();
    grids::parallel_fill(w.data(), w.size(), 0.0);
    const auto apply = [&](const double* in, double* out) { apply_operator(in, out); };
    // c is nearer than w by the operator's size, where that is small enough to be relied on.
    const double needed = spread_ < 0.1 ? tolerance / std::max(spread_, 1e-3) : tolerance;
    const auto outcome = gmres_->solve(
        apply, start_.all().first(w.size()), w,
        {.tolerance = std::min(needed, 1e-2), .acceptable = std::max(100.0 * tolerance, 1e-13), .max_iterations = 200});
    if (outcome.status != Status::success) {
      return outcome.status;
    }
    finish(w.data(), solution);
    error_ = outcome.residual * std::min(1.0, spread_);
    return Status::success;
  }

  /// c of w, and how far (C⁻¹ r)_w was from c_w.
  void finish(const double* w, std::span<double* const> solution) {
    multiply_variation(w);
    inverse_.solve_all(rows_, std::as_const(products_).pointers().first(rows_.size()), solution);
    double distance = 0.0;
    double size = 0.0;
    for (std::size_t j = 0; j < columns_.size(); ++j) {
      const double* c = solution[static_cast<std::size_t>(columns_[j])];
      const double* first = start_.field(static_cast<int>(j)).data();
      distance += grids::sum_of(grid_.size(), [=](std::size_t i) { return (c[i] - first[i]) * (c[i] - first[i]); });
      size += grids::dot({c, grid_.size()}, {c, grid_.size()});
    }
    spread_ = size > 0.0 ? std::sqrt(distance / size) : 0.0;
  }

  /// out = w + (C⁻¹ V A w)_w.
  void apply_operator(const double* w, double* out) {
    multiply_variation(w);
    for (std::size_t j = 0; j < columns_.size(); ++j) {
      outputs_[j] = out + j * grid_.size();
    }
    inverse_.respond(rows_, std::as_const(products_).pointers().first(rows_.size()), columns_,
                     std::span<double* const>(outputs_.data(), columns_.size()));
    grids::for_each_block(columns_.size() * grid_.size(), 4096, [=](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        out[i] += w[i];
      }
    });
  }

  /// products = V A w, of which ghosts may be anything.
  void multiply_variation(const double* w) {
    if (reads_ghosts_) {
      std::copy_n(w, columns_.size() * grid_.size(), with_ghosts_.all().begin());
      grids::refresh_ghosts(with_ghosts_, std::span(all_).first(columns_.size()));
      w = std::as_const(with_ghosts_).all().data();
    }
    if (elements_ != nullptr) {
      for (std::size_t j = 0; j < columns_.size(); ++j) {
        (*elements_)(w + j * grid_.size(), means_at_points_.field(static_cast<int>(j)).data(), nullptr);
      }
      w = std::as_const(means_at_points_).all().data();
    }
    grids::for_each_block(blocks_.count(), 1, [&](std::size_t first, std::size_t last) {
      double mean[CellBlocks::most];
      double* const none[3] = {};
      for (std::size_t block = first; block < last; ++block) {
        const std::size_t line = block / blocks_.per_line;
        const std::size_t begin = block % blocks_.per_line * CellBlocks::most;
        const std::size_t count = std::min(CellBlocks::most, blocks_.line - begin);
        const std::size_t offset = line * blocks_.line + begin;
        for (std::size_t r = 0; r < rows_.size(); ++r) {
          std::fill_n(products_.field(static_cast<int>(r)).data() + offset, count, 0.0);
        }
        for (std::size_t j = 0; j < columns_.size(); ++j) {
          take_mean(w + j * grid_.size(), line, begin, count, mean, none);
          for (const Variation& v : variation_) {
            if (v.column != j) {
              continue;
            }
            double* out = products_.field(static_cast<int>(v.row)).data() + offset;
            const double* values = v.values != nullptr ? v.values + offset : nullptr;
            for (std::size_t i = 0; i < count; ++i) {
              out[i] += (v.shift + (values != nullptr ? v.factor * values[i] : 0.0)) * mean[i];
            }
          }
        }
      }
    });
    to_rows(products_, static_cast<int>(rows_.size()));
  }

  /// Values at the points of elements become the grid functions that C⁻¹ takes.
  void to_rows(grids::FieldSet& values, int rows) {
    for (int r = 0; elements_ != nullptr && r < rows; ++r) {
      elements_->to_row(values.field(r).data(), values.field(r).data());
    }
  }

  void take_mean(const double* field, std::size_t line, std::size_t begin, std::size_t count, double* mean,
                 double* const* none) const {
    if (collocation_ == Collocation::nodes || elements_ != nullptr) {
      std::copy_n(field + line * blocks_.line + begin, count, mean);
    } else {
      gather_(field, line, begin, count, mean, none);
    }
  }

  /// Makes the residual of the whole system as small as asked, or as rounding allows.
  Status refine(const CellMatrix& matrix, std::span<const double* const> rhs, std::span<double* const> solution) {
    double square = 0.0;
    for (int r = 0; r < size_; ++r) {
      const std::span row(rhs[static_cast<std::size_t>(r)], grid_.size());
      square += grids::dot(row, row);
    }
    const double size = std::sqrt(square);
    if (correction_.fields() == 0) {
      correction_ = grids::FieldSet(size_, grid_.size());
      residual_ = grids::FieldSet(size_, grid_.size());
      const bool local = spectral_ == nullptr && elements_ == nullptr;
      for (int a = 0; !local && a < grid_.dimensions(); ++a) {
        derivative_.emplace_back(size_, grid_.size());
      }
      values_ = elements_ != nullptr || reads_ghosts_ ? correction_ : grids::FieldSet();
    }
    double previous = 0.0;
    for (int pass = 0;; ++pass) {
      multiply(matrix, solution);
      for (int f = 0; f < size_; ++f) {
        double* r = residual_.field(f).data();
        const double* b = rhs[static_cast<std::size_t>(f)];
        grids::for_each_block(grid_.size(), 4096, [=](std::size_t begin, std::size_t end) {
          for (std::size_t i = begin; i < end; ++i) {
            r[i] = b[i] - r[i];
          }
        });
      }
      const double left = size > 0.0 ? std::sqrt(grids::dot(residual_.all(), residual_.all())) / size : 0.0;
      if (!std::isfinite(left)) {
        return Status::undefined;
      }
      if (left <= tolerance_) {
        return Status::success;
      }
      if (pass == most_refinements || (pass > 0 && left > 0.5 * previous)) {
        return left <= 100.0 * tolerance_ ? Status::success : Status::not_converged;
      }
      previous = left;
      const double error = error_;
      const Status status = solve_once(std::as_const(residual_).pointers(), correction_.pointers(), 1e-3);
      if (status != Status::success) {
        return status;
      }
      error_ = std::min(error, error_ * left);
      for (int f = 0; f < size_; ++f) {
        double* out = solution[static_cast<std::size_t>(f)];
        const double* change = std::as_const(correction_).field(f).data();
        grids::for_each_block(grid_.size(), 4096, [=](std::size_t begin, std::size_t end) {
          for (std::size_t i = begin; i < end; ++i) {
            out[i] += change[i];
          }
        });
      }
    }
  }

  Status factor(const CellMatrix& matrix) {
    const auto list = [this](const MatrixXd& of, MatrixTerms& terms) {
      terms.clear();
      for (int r = 0; r < size_; ++r) {
        for (int c = 0; c < size_; ++c) {
          if (of(r, c) != 0.0) {
            terms.push_back({r, c, of(r, c)});
          }
        }
      }
    };
    MatrixTerms& constants = inverted_terms_;
    std::vector<MatrixTerms>& differences = difference_terms_;
    list(inverted_, constants);
    differences.resize(matrix.difference.size());
    for (std::size_t a = 0; a < differences.size(); ++a) {
      list(matrix.difference[a], differences[a]);
      double largest = 0.0;
      for (const double slope : slopes_[a]) {
        largest = std::max(largest, std::abs(slope));
      }
      sizes_ += largest * matrix.difference[a].cwiseAbs();
    }
    std::vector<double>& sizes = sizes_by_rows_;
    sizes.clear();
    for (int i = 0; i < size_ * size_; ++i) {
      sizes.push_back(sizes_(i / size_, i % size_));
    }
    const auto entries = [&](const std::array<std::ptrdiff_t, 3>& k, std::complex<double>* out) {
      for (const MatrixTerm& term : constants) {
        out[term.row * size_ + term.column] += term.value;
      }
      for (std::size_t a = 0; a < differences.size(); ++a) {
        const auto waves = static_cast<std::ptrdiff_t>(slopes_[a].size());
        const double slope = slopes_[a][static_cast<std::size_t>(k[a] < 0 ? k[a] + waves : k[a])];
        for (const MatrixTerm& term : differences[a]) {
          out[term.row * size_ + term.column] += std::complex<double>(0.0, term.value * slope);
        }
      }
    };
    return inverse_.factor(std::ref(entries), sizes, averages_);  // a std::function holds it without memory of its own
  }

  /// residual = matrix · in.
  void multiply(const CellMatrix& matrix, std::span<double* const> in) {
    if (elements_ != nullptr) {
      for (int f = 0; f < size_; ++f) {
        (*elements_)(in[static_cast<std::size_t>(f)], values_.field(f).data(), derivative_[0].field(f).data());
      }
      in = values_.pointers();
    } else if (reads_ghosts_) {
      for (int f = 0; f < size_; ++f) {
        std::copy_n(in[static_cast<std::size_t>(f)], grid_.size(), values_.field(f).begin());
      }
      grids::refresh_ghosts(values_);
      in = values_.pointers();
    }
    for (std::size_t a = 0; spectral_ != nullptr && a < derivative_.size(); ++a) {
      for (int f = 0; f < size_; ++f) {
        if (!matrix.difference[a].col(f).isZero(0.0)) {
          (*spectral_)(static_cast<int>(a), in[static_cast<std::size_t>(f)], derivative_[a].field(f).data());
        }
      }
    }
    grids::for_each_block(blocks_.count(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t block = first; block < last; ++block) {
        multiply_block(matrix, in, block);
      }
    });
    to_rows(residual_, size_);
  }

  void multiply_block(const CellMatrix& matrix, std::span<double* const> in, std::size_t block) {
    const std::size_t line = block / blocks_.per_line;
    const std::size_t begin = block % blocks_.per_line * CellBlocks::most;
    const std::size_t count = std::min(CellBlocks::most, blocks_.line - begin);
    const std::size_t offset = line * blocks_.line + begin;
    double mean[CellBlocks::most];
    double difference[3][CellBlocks::most];
    double* const differences[3] = {difference[0], difference[1], difference[2]};
    for (int r = 0; r < size_; ++r) {
      std::fill_n(residual_.field(r).data() + offset, count, 0.0);
    }
    for (int f = 0; f < size_; ++f) {
      if (derivative_.empty()) {
        gather_(in[static_cast<std::size_t>(f)], line, begin, count, mean, differences);
      } else {
        std::copy_n(in[static_cast<std::size_t>(f)] + offset, count, mean);
        for (std::size_t a = 0; a < derivative_.size(); ++a) {
          std::copy_n(derivative_[a].field(f).data() + offset, count, differences[a]);
        }
      }
      for (int r = 0; r < size_; ++r) {
        double* to = residual_.field(r).data() + offset;
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
          double* to = residual_.field(entry.row).data() + offset;
          const double* values = entry.values + offset;
          for (std::size_t c = 0; c < count; ++c) {
            to[c] += entry.factor * values[c] * mean[c];
          }
        }
      }
    }
  }

  struct Variation {
    std::size_t row, column;  ///< places in rows_ and columns_
    double factor, shift;
    const double* values;  ///< may be null
  };

  grids::Grid grid_, whole_;
  Collocation collocation_;
  int size_;
  double tolerance_;
  CellBlocks blocks_;
  BoxGather gather_;
  solve::FourierPreconditioner inverse_;                     ///< C⁻¹
  std::vector<std::vector<std::complex<double>>> averages_;  ///< A of each axis, waves k < 0 at k + n
  std::vector<std::vector<double>> slopes_;                  ///< D/iA
  std::vector<int> all_;
  grids::FieldSet rhs_;                                  ///< where conditions or elements change it
  std::unique_ptr<grids::SpectralDerivative> spectral_;  ///< at nodes only
  std::unique_ptr<ElementOperators> elements_;           ///< in elements only
  bool check_ = true;
  double error_ = 0.0;  ///< of the last solution, relative

  MatrixXd prepared_;  ///< the constants that C was made of, if
  bool is_prepared_ = false;
  MatrixXd inverted_;  ///< with the entries' means
  MatrixXd sizes_;     ///< the sum of what its entries are made of, and of differences
  std::vector<double> sizes_by_rows_;
  MatrixTerms inverted_terms_;                 ///< of it
  std::vector<MatrixTerms> difference_terms_;  ///< of the matrix' differences
  std::vector<double> means_of_entries_;
  double spread_ = 0.0;  ///< the operator's size, as last seen
  std::vector<Variation> variation_;
  std::vector<int> rows_, columns_;           ///< that V touches
  grids::FieldSet start_, image_, products_;  ///< (C⁻¹ r)_w, w, V A w
  bool reads_ghosts_;                         ///< of a slab, whose transforms and sums know nothing of them
  grids::FieldSet with_ghosts_;               ///< w
  std::array<double*, 16> outputs_{};
  std::unique_ptr<solve::Gmres> gmres_;      ///< for w
  grids::FieldSet correction_, residual_;    ///< of refinements, made when first needed
  std::vector<grids::FieldSet> derivative_;  ///< at nodes and in elements, along each axis
  grids::FieldSet means_at_points_;          ///< in elements, of w
  grids::FieldSet values_;                   ///< of a solution: at points of elements, or with ghosts
  std::vector<double> means_;
};

}  // namespace

std::unique_ptr<CellSolver> make_gmres_cell_solver(const grids::Grid& grid, Collocation collocation, int size,
                                                   double tolerance) {
  return std::make_unique<GmresCellSolver>(grid, collocation, size, tolerance);
}

std::unique_ptr<CellSolver> make_cell_solver(const grids::Grid& grid, Collocation collocation, int size, int conditions,
                                             double tolerance) {
  if (grid.dimensions() == 1 && collocation == Collocation::cells) {
    return make_cyclic_cell_solver(grid, size, conditions);
  }
  return make_gmres_cell_solver(grid, collocation, size, tolerance);
}

}  // namespace rubato
