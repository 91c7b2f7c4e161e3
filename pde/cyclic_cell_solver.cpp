#include <rubato/pde/cell_solver.hpp>

#include <algorithm>

#include <rubato/grids/slab.hpp>
#include <rubato/solve/cyclic_block.hpp>

namespace rubato {

namespace {

class CyclicCellSolver final : public CellSolver {
public:
  CyclicCellSolver(const grids::Grid& grid, int size, int conditions)
      : inverse_spacing_(1.0 / grid.spacing(0)),
        slab_(grids::Slab::of(grid)),
        cells_(slab_ == nullptr ? grid.cells(0) : slab_->whole().cells(0)),
        first_(slab_ == nullptr ? 0 : slab_->first_node()),
        rows_(static_cast<std::size_t>(size)),
        solver_(size, cells_, conditions, 1, slab_),
        rhs_(static_cast<std::size_t>(size)),
        solution_(rhs_.size()),
        last_(rhs_.size()),
        before_(rhs_.size()) {
    const auto block = static_cast<std::size_t>(size);
    const auto count = static_cast<std::size_t>(conditions);
    matrix_.block = size;
    matrix_.cells = slab_ == nullptr ? cells_ : slab_->owned();
    matrix_.left.resize(block * block);
    matrix_.right.resize(block * block);
    border_.count = conditions;
    border_.columns.resize(count * block);
    border_.rows.resize(count * block);
    border_.corner.assign(count * count, 0.0);
    border_rhs_.assign(count, 0.0);
  }

  Status solve(const CellMatrix& matrix, const KernelConditions& conditions, std::span<const double* const> rhs,
               std::span<double* const> solution, std::span<double> y) override {
    const int d = matrix_.block;
    order_rows(matrix);
    std::size_t next = 0;
    for (const int i : rows_) {
      for (int j = 0; j < d; ++j) {
        const double mean = 0.5 * matrix.mean(i, j);
        const double difference = inverse_spacing_ * matrix.difference[0](i, j);
        matrix_.left[next] = mean - difference;
        matrix_.right[next++] = mean + difference;
      }
    }
    const bool closes = matrix.last_left.size() > 0;
    matrix_.last_left.resize(closes ? matrix_.left.size() : 0);
    matrix_.last_right.resize(matrix_.last_left.size());
    for (std::size_t i = 0; i < matrix_.last_left.size(); ++i) {
      const auto row = rows_[i / static_cast<std::size_t>(d)];
      const auto column = static_cast<Eigen::Index>(i % static_cast<std::size_t>(d));
      matrix_.last_left[i] = matrix.last_left(row, column);
      matrix_.last_right[i] = matrix.last_right(row, column);
    }
    matrix_.entries.clear();
    for (const CellMatrix::Entry& entry : matrix.entries) {
      matrix_.entries.push_back(
          {place_of(entry.row), entry.column, 0.5 * entry.factor, 0.5 * entry.factor, entry.values + first_});
    }
    const double weight = 1.0 / static_cast<double>(cells_);
    next = 0;
    for (int b = 0; b < conditions.count(); ++b) {
      for (int i = 0; i < d; ++i) {
        border_.columns[next].constant = conditions.columns(rows_[static_cast<std::size_t>(i)], b);
        border_.rows[next++].constant = weight * conditions.pins(b, i);
      }
    }
    std::ranges::transform(rows_, rhs_.begin(), [&](int row) { return rhs[static_cast<std::size_t>(row)] + first_; });
    std::ranges::transform(solution, solution_.begin(), [this](double* values) { return values + first_; });
    const Status status = solver_.solve(matrix_, border_, rhs_, border_rhs_, solution_, y, check_).status;
    if (slab_ != nullptr && status == Status::success) {
      find_ghosts();
    }
    return status;
  }
  [[nodiscard]] bool finds_ghosts() const override { return true; }

  void check_residuals(bool on) override {
    check_ = on ? solve::CyclicCheck::every_solve : solve::CyclicCheck::left_to_caller;
  }

private:
  /// Puts an equation at place j if it is the only one with a constant coefficient in column j. Elimination by
  /// reflections mixes the rows that a column has entries in with the row at its own place. In this order an unknown
  /// that is coupled to no others gets no rounding errors of theirs, and a field that is 0 stays 0.
  void order_rows(const CellMatrix& matrix) {
    const int d = matrix.size();
    const auto is_placed = [this](int row) { return std::ranges::find(rows_, row) != rows_.end(); };
    std::ranges::fill(rows_, -1);
    for (int j = 0; j < d; ++j) {
      int only = -1, count = 0;
      for (int i = 0; i < d; ++i) {
        if (matrix.mean(i, j) != 0.0 || matrix.difference[0](i, j) != 0.0) {
          only = i;
          ++count;
        }
      }
      if (count == 1 && !is_placed(only)) {
        rows_[static_cast<std::size_t>(j)] = only;
      }
    }
    int next = 0;
    for (int& row : rows_) {
      if (row < 0) {
        while (is_placed(next)) {
          ++next;
        }
        row = next;
      }
    }
  }
  [[nodiscard]] int place_of(int row) const { return static_cast<int>(std::ranges::find(rows_, row) - rows_.begin()); }

  /// The node behind a part, which separates it from the next, is part of the solution; the one before it is not.
  void find_ghosts() {
    std::ranges::transform(solution_, last_.begin(),
                           [this](const double* values) { return values[matrix_.cells - 1]; });
    slab_->pass_on(last_, before_);
    for (std::size_t f = 0; f < solution_.size(); ++f) {
      solution_[f][-1] = before_[f];
    }
  }

  double inverse_spacing_;
  const grids::Slab* slab_;  ///< of the ranks that share the line; null for one process
  std::size_t cells_;        ///< of all ranks
  std::size_t first_;        ///< of the nodes that are owned
  std::vector<int> rows_;    ///< the equation at each place
  solve::CyclicBlockSolver solver_;
  solve::CyclicBidiagonal matrix_;
  solve::CyclicBorder border_;
  std::vector<double> border_rhs_;
  std::vector<const double*> rhs_;
  std::vector<double*> solution_;
  std::vector<double> last_, before_;  ///< the solution at the last node of this part, and of the one before
  solve::CyclicCheck check_ = solve::CyclicCheck::every_solve;
};

}  // namespace

std::unique_ptr<CellSolver> make_cyclic_cell_solver(const grids::Grid& grid, int size, int conditions) {
  return std::make_unique<CyclicCellSolver>(grid, size, conditions);
}

}  // namespace rubato
