#include <rubato/pde/action_newton.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/SparseCore>

#include <rubato/base/limits.hpp>
#include <rubato/grids/arrays.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/fourier_preconditioner.hpp>
#include <rubato/solve/gmres.hpp>
#include <rubato/solve/sparse_factors.hpp>

namespace rubato {

using namespace tuning::action_newton;

namespace {

using Eigen::VectorXd;
using formula::Expression;
using grids::FieldSet;
/// Residuals in units of the rounding error of their terms: below the first nothing is solved for where a matrix that
/// turns them into much more is met by GMRES; up to the second a correction that no longer falls is rounding.
constexpr double few_roundings = 2.0, many_roundings = 64.0;

using Sparse = Eigen::SparseMatrix<double>;

bool depends_on_state(const ActionRows& rows, Expression formula) {
  if (!rows.upper_inputs(formula).empty()) {
    return true;
  }
  const auto numbers = formula::variables_of(formula);
  return numbers.size() > 1 || (numbers.size() == 1 && numbers.front() != formula::variables_of(rows.step()).front());
}

}  // namespace

struct ActionNewton::Storage {
  Storage(ActionRows& rows, const ActionEquations& equations, ActionKernel held)
      : entries(equations.entries),
        kernel(std::move(held)),
        grid(rows.grid()),
        n(grid.size()),
        fields(equations.fields) {
    std::vector<Expression> formulas;
    for (const ActionEquations::Entry& entry : entries) {
      formulas.push_back(entry.value);
      is_constant = is_constant && !depends_on_state(rows, entry.value);
    }
    code = rows.variation().code(formulas);
    values = FieldSet(static_cast<int>(entries.size()), n);
    largest_entries.resize(entries.size(), 0.0);
    if (grid.dimensions() > 1) {
      iterative.emplace(grid, static_cast<int>(fields.size()));
    }
    size = static_cast<int>(fields.size() * n + (iterative ? 0 : kernel.modes.size()));
    find_pattern();
  }

  /// On a line unknowns go node by node, for a narrow band, and then one for each mode that is held; else field by
  /// field.
  [[nodiscard]] int unknown(int field, std::size_t node) const {
    return iterative ? static_cast<int>(static_cast<std::size_t>(field) * n + node)
                     : static_cast<int>(node * fields.size()) + field;
  }
  [[nodiscard]] std::size_t neighbour(std::size_t node, const std::array<int, 3>& offset) const {
    auto place = grid.place(node);
    for (std::size_t a = 0; a < place.size(); ++a) {
      const auto count = static_cast<std::ptrdiff_t>(grid.cells(static_cast<int>(a)));
      const std::ptrdiff_t moved = (static_cast<std::ptrdiff_t>(place[a]) + offset[a]) % count;
      place[a] = static_cast<std::size_t>(moved < 0 ? moved + count : moved);
    }
    return grid.index(place[0], place[1], place[2]);
  }
  [[nodiscard]] double sign_of(const std::array<bool, 3>& sawtooth, std::size_t node) const {
    const auto place = grid.place(node);
    double sign = 1.0;
    for (std::size_t a = 0; a < place.size(); ++a) {
      sign = sawtooth[a] && place[a] % 2 != 0 ? -sign : sign;
    }
    return sign;
  }

  void find_pattern() {
    std::vector<Eigen::Triplet<double>> triplets;
    for (std::size_t e = 0; e < entries.size(); ++e) {
      for (std::size_t i = 0; i < n; ++i) {
        triplets.emplace_back(unknown(entries[e].row, i), unknown(entries[e].column, neighbour(i, entries[e].offset)),
                              1.0);
      }
    }
    for (std::size_t b = 0; !iterative && b < kernel.modes.size(); ++b) {
      const int last = static_cast<int>(fields.size() * n + b);
      for (std::size_t i = 0; i < n; ++i) {
        triplets.emplace_back(last, unknown(kernel.modes[b].pinned, i), sign_of(kernel.modes[b].sawtooth, i));
        for (int r = 0; r < static_cast<int>(fields.size()); ++r) {
          if (const double weight = kernel.rows[b].weights(r); weight != 0.0) {
            triplets.emplace_back(unknown(r, i), last, weight * sign_of(kernel.rows[b].sawtooth, i));
          }
        }
      }
    }
    matrix = Sparse(size, size);
    matrix.setFromTriplets(triplets.begin(), triplets.end());
    matrix.makeCompressed();
    border = VectorXd(matrix.nonZeros());
    std::copy_n(matrix.valuePtr(), matrix.nonZeros(), border.data());
    places.resize(entries.size() * n);
    std::vector<bool> is_entry(static_cast<std::size_t>(matrix.nonZeros()), false);
    for (std::size_t e = 0; e < entries.size(); ++e) {
      for (std::size_t i = 0; i < n; ++i) {
        const int row = unknown(entries[e].row, i),
                  column = unknown(entries[e].column, neighbour(i, entries[e].offset));
        const int* const begin = matrix.innerIndexPtr() + matrix.outerIndexPtr()[column];
        const int* const end = matrix.innerIndexPtr() + matrix.outerIndexPtr()[column + 1];
        const auto place = std::lower_bound(begin, end, row) - matrix.innerIndexPtr();
        places[e * n + i] = static_cast<int>(place);
        is_entry[static_cast<std::size_t>(place)] = true;
      }
    }
    for (Eigen::Index k = 0; k < matrix.nonZeros(); ++k) {
      border(k) = is_entry[static_cast<std::size_t>(k)] ? 0.0 : border(k);
    }
    right = VectorXd::Zero(size);
  }

  [[nodiscard]] bool factor(double h, const Read& read) {
    read(code);
    code(values.pointers());
    std::copy_n(border.data(), matrix.nonZeros(), matrix.valuePtr());
    for (std::size_t e = 0; e < entries.size(); ++e) {
      const auto from = std::as_const(values).field(static_cast<int>(e));
      for (std::size_t i = 0; i < n; ++i) {
        matrix.valuePtr()[places[e * n + i]] += from[i];
      }
    }
    for (std::size_t e = 0; e < entries.size(); ++e) {
      largest_entries[e] = grids::max_abs(std::as_const(values).field(static_cast<int>(e)));
    }
    if (iterative) {
      is_factored = factor_means();
    } else {
      is_factored = factors.factor(matrix, std::exchange(is_analysed, true)) == Status::success;
    }
    factored_h = h;
    return is_factored;
  }
  /// The matrix with the means of its entries, inverted wave by wave.
  [[nodiscard]] bool factor_means() {
    const std::size_t count = fields.size();
    std::vector<double> means, sizes(count * count, 0.0);
    for (std::size_t e = 0; e < entries.size(); ++e) {
      means.push_back(grids::sum(std::as_const(values).field(static_cast<int>(e))) / static_cast<double>(n));
      sizes[static_cast<std::size_t>(entries[e].row) * count + static_cast<std::size_t>(entries[e].column)] +=
          std::abs(means.back());
    }
    const auto symbol = [&](const std::array<std::ptrdiff_t, 3>& k, std::complex<double>* out) {
      std::fill_n(out, count * count, std::complex<double>());
      for (std::size_t e = 0; e < entries.size(); ++e) {
        double phase = 0.0;
        for (std::size_t a = 0; a < k.size(); ++a) {
          phase += 2.0 * std::numbers::pi * static_cast<double>(k[a] * entries[e].offset[a]) /
                   static_cast<double>(grid.cells(static_cast<int>(a)));
        }
        out[static_cast<std::size_t>(entries[e].row) * count + static_cast<std::size_t>(entries[e].column)] +=
            means[e] * std::polar(1.0, phase);
      }
    };
    return iterative->means.factor(symbol, sizes) == Status::success;
  }

  /// Whether the factors may begin a search at a step of length h.
  [[nodiscard]] bool serves(double h) const {
    return is_factored && (is_constant || of_other_level ? is_constant && h == factored_h
                                                         : std::abs(h - factored_h) <= action_nearby * std::abs(h));
  }

  /// Solves for corrections that make up for `of_rows`, and for how far held modes of `to` are from those of `from`.
  [[nodiscard]] bool solve_values(const FieldSet& of_rows, const FieldSet* from, const FieldSet& to) {
    for (std::size_t r = 0; r < fields.size(); ++r) {
      const auto values_of = of_rows.field(static_cast<int>(r));
      for (std::size_t i = 0; i < n; ++i) {
        right(unknown(static_cast<int>(r), i)) = -values_of[i];
      }
    }
    for (std::size_t b = 0; !iterative && b < kernel.modes.size(); ++b) {
      const int field = fields[static_cast<std::size_t>(kernel.modes[b].pinned)];
      double moved = 0.0;
      for (std::size_t i = 0; i < n; ++i) {
        const double held = from == nullptr ? 0.0 : from->field(field)[i];
        moved += sign_of(kernel.modes[b].sawtooth, i) * (to.field(field)[i] - held);
      }
      right(static_cast<Eigen::Index>(fields.size() * n + b)) = -moved;
    }
    if (!iterative) {
      solution = factors.solve(right);
      return solution.allFinite();
    }
    solution = VectorXd::Zero(size);
    if (right.isZero(0.0)) {
      return true;
    }
    const auto apply = [this](const double* in, double* out) {
      iterative->means(in, iterative->image.data());
      Eigen::Map<VectorXd>(out, size).noalias() = matrix * iterative->image;
    };
    const solve::GmresOutcome outcome = iterative->gmres.solve(
        apply, {right.data(), static_cast<std::size_t>(size)}, {solution.data(), static_cast<std::size_t>(size)},
        {.tolerance = krylov_tolerance, .acceptable = krylov_acceptable});
    iterative->means(solution.data(), solution.data());
    return outcome.status == Status::success && solution.allFinite();
  }

  /// The largest residual of a row in units of the rounding error of its terms, |matrix| |values|.
  [[nodiscard]] double roundings(const FieldSet& of_rows, std::span<const double> sizes) const {
    std::vector<double> terms(fields.size(), 0.0);
    for (std::size_t e = 0; e < entries.size(); ++e) {
      terms[static_cast<std::size_t>(entries[e].row)] +=
          largest_entries[e] * sizes[static_cast<std::size_t>(entries[e].column)];
    }
    double largest = 0.0;
    for (std::size_t r = 0; r < fields.size(); ++r) {
      const double size_of = grids::max_abs(of_rows.field(static_cast<int>(r)));
      largest = size_of == 0.0 ? largest : std::max(largest, size_of / (epsilon * terms[r]));
    }
    return largest;
  }

  /// to += the corrections. \return the largest change of a field relative to its size, or to a part of what the others
  /// have in its unit: a field that is 0 has but their rounding
  double add_solution(FieldSet& to, std::span<double> sizes) const {
    std::vector<double> changes;
    double largest = 0.0, change = 0.0;
    for (std::size_t f = 0; f < fields.size(); ++f) {
      const auto values_of = to.field(fields[f]);
      double& of_field = changes.emplace_back(0.0);
      for (std::size_t i = 0; i < n; ++i) {
        const double correction = solution(unknown(static_cast<int>(f), i));
        values_of[i] += correction;
        of_field = std::max(of_field, std::abs(correction));
        sizes[f] = std::max(sizes[f], std::abs(values_of[i]));
      }
      largest = std::max(largest, sizes[f] / kernel.units(static_cast<Eigen::Index>(f)));
    }
    for (std::size_t f = 0; f < fields.size(); ++f) {
      const double size_of = std::max(sizes[f], part_of_others * largest * kernel.units(static_cast<Eigen::Index>(f)));
      change = std::max(change, size_of > 0.0 ? changes[f] / size_of : 0.0);
    }
    return change;
  }

  std::vector<ActionEquations::Entry> entries;
  ActionKernel kernel;
  grids::Grid grid;
  std::size_t n;
  std::vector<int> fields;
  NodeCode code;
  FieldSet values;
  int size = 0;
  Sparse matrix;
  VectorXd border;  ///< entries of the border, 0 elsewhere
  std::vector<double> largest_entries;
  std::vector<int> places;  ///< of each entry at each node in the matrix
  VectorXd right, solution;
  solve::SparseFactors factors;
  /// In more than one dimension, where factors fill up. The pseudo-inverse of the means leaves held modes alone.
  struct Iterative {
    Iterative(const grids::Grid& of, int count)
        : means(of, count), gmres(static_cast<std::size_t>(count) * of.size(), krylov_restart), image(gmres.size()) {}
    solve::FourierPreconditioner means;
    solve::Gmres gmres;
    VectorXd image;  ///< of the means' inverse
  };
  std::optional<Iterative> iterative;
  bool is_constant = true;  ///< the matrix depends on h alone
  bool is_analysed = false, is_factored = false, of_other_level = false;
  double factored_h = 0.0;
};

ActionNewton::ActionNewton(ActionRows& rows, const ActionEquations& equations, ActionKernel kernel)
    : storage_(std::make_unique<Storage>(rows, equations, std::move(kernel))) {}
ActionNewton::~ActionNewton() = default;
ActionNewton::ActionNewton(ActionNewton&&) noexcept = default;
ActionNewton& ActionNewton::operator=(ActionNewton&&) noexcept = default;

void ActionNewton::leave_level() {
  storage_->of_other_level = true;
}

Status ActionNewton::solve(double h, double accuracy, const FieldSet& before, FieldSet& after, const Read& read,
                           NodeCode& row, FieldSet& values) {
  Storage& s = *storage_;
  std::vector<double> sizes;
  for (const int f : s.fields) {
    sizes.push_back(grids::max_abs(before.field(f)));
  }
  bool fresh = false;
  if (!s.serves(h)) {
    if (!s.factor(h, read)) {
      return Status::not_converged;
    }
    fresh = true;
  }
  s.of_other_level = false;
  double last = 0.0;
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    read(row);
    row(values.pointers());
    if (!std::isfinite(grids::max_abs(std::as_const(values).all()))) {
      return Status::undefined;
    }
    const double left = s.roundings(values, sizes);
    if (s.iterative && left <= few_roundings) {
      return Status::success;
    }
    if (!s.solve_values(values, &before, after)) {
      return iteration > 0 && left <= many_roundings ? Status::success : Status::not_converged;
    }
    const double change = s.add_solution(after, sizes);
    const bool is_rounding = change <= action_rounding || left <= many_roundings;
    if (change <= action_enough || (iteration > 0 && is_rounding && change >= stall * last)) {
      return Status::success;
    }
    const double contraction = iteration > 0 ? change / last : 1.0;
    if (iteration > 0 && contraction < 1.0 && accuracy > 0.0 && change * contraction <= accuracy) {
      return Status::success;
    }
    if (!(change < diverged)) {
      return Status::not_converged;
    }
    if (!s.is_constant && change > action_rounding &&
        (iteration > 0 ? contraction > slow : !fresh && change > action_nearby)) {
      if (!s.factor(h, read)) {
        return Status::not_converged;
      }
      fresh = true;
    }
    last = change;
  }
  return Status::not_converged;
}

bool ActionNewton::solve_linear(double h, FieldSet& direction, const Read& read, NodeCode& right, NodeCode& along,
                                FieldSet& values) {
  Storage& s = *storage_;
  if (!s.serves(h) && !s.factor(h, read)) {
    return false;
  }
  s.of_other_level = false;
  std::vector<double> sizes(s.fields.size(), 0.0);
  FieldSet fixed(values.fields(), values.size());
  read(right);
  right(fixed.pointers());
  double last = 0.0;
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    read(along);
    along(values.pointers());
    for (int r = 0; r < values.fields(); ++r) {
      grids::add(1.0, std::as_const(fixed).field(r), values.field(r));
    }
    if (!s.solve_values(values, nullptr, direction)) {
      return false;
    }
    const double change = s.add_solution(direction, sizes);
    if (change <= action_enough || (iteration > 0 && change >= stall * last)) {
      return iteration == 0 || change <= linear_rounding;
    }
    if (iteration > 0 && change > slow * last && !s.factor(h, read)) {
      return false;
    }
    last = change;
  }
  return false;
}

}  // namespace rubato
