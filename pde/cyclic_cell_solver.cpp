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
    std::size_t next = 0;
    for (int i = 0; i < d; ++i) {
      for (int j = 0; j < d; ++j) {
        const double mean = 0.5 * matrix.mean(i, j);
        const double difference = inverse_spacing_ * matrix.difference[0](i, j);
        matrix_.left[next] = mean - difference;
        matrix_.right[next++] = mean + difference;
      }
    }
    matrix_.entries.clear();
    for (const CellMatrix::Entry& entry : matrix.entries) {
      matrix_.entries.push_back(
          {entry.row, entry.column, 0.5 * entry.factor, 0.5 * entry.factor, entry.values + first_});
    }
    const double weight = 1.0 / static_cast<double>(cells_);
    next = 0;
    for (int b = 0; b < conditions.count(); ++b) {
      for (int i = 0; i < d; ++i) {
        border_.columns[next].constant = conditions.columns(i, b);
        border_.rows[next++].constant = weight * conditions.pins(b, i);
      }
    }
    std::ranges::transform(rhs, rhs_.begin(), [this](const double* values) { return values + first_; });
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
