#include <rubato/pde/action_kernel.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>
#include <random>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Core>

#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using formula::Expression;

constexpr int states = 3;
/// Singular values of scaled symbols, whose entries are about 1, that count as zero.
constexpr double threshold = 1e-9;

/// The entries at fields that are the same everywhere, of several random states.
class Symbols {
public:
  Symbols(const ActionRows& rows, const ActionEquations& equations, double h)
      : entries_(equations.entries), size_(static_cast<Index>(equations.fields.size())) {
    std::vector<Expression> formulas;
    for (const ActionEquations::Entry& entry : entries_) {
      formulas.push_back(entry.value);
    }
    const auto is_defined = [&](const ActionRows::Probe& probe) {
      take_values(rows, formulas, h, probe);
      return std::ranges::all_of(values_, [](const std::vector<double>& state) {
        return std::ranges::all_of(state, [](double value) { return std::isfinite(value); });
      });
    };
    if (std::ranges::none_of(rows.probes(), is_defined)) {
      throw std::invalid_argument(fmt::format(
          "the second derivatives of L are not defined at steps of {:.3g}, neither at fields between 0.2 and "
          "1.2 nor near the initial data: state an L that has them there",
          h));
    }
    MatrixXd sizes = MatrixXd::Zero(size_, size_);
    for (const std::vector<double>& state : values_) {
      for (std::size_t e = 0; e < entries_.size(); ++e) {
        sizes(entries_[e].row, entries_[e].column) += std::abs(state[e]);
      }
    }
    scale(sizes);
  }

  /// The symbols of all states on one wave, one below the other, scaled; of the transposed ones.
  ///@{
  [[nodiscard]] MatrixXcd stacked(const std::array<double, 3>& wave) const {
    MatrixXcd all(states * size_, size_);
    for (int state = 0; state < states; ++state) {
      all.middleRows(state * size_, size_) = symbol(state, wave);
    }
    return all;
  }
  [[nodiscard]] MatrixXcd transposed(const std::array<double, 3>& wave) const {
    MatrixXcd all(states * size_, size_);
    for (int state = 0; state < states; ++state) {
      all.middleRows(state * size_, size_) = symbol(state, wave).transpose();
    }
    return all;
  }
  ///@}
  [[nodiscard]] const VectorXd& row_scale() const { return row_scale_; }
  [[nodiscard]] const VectorXd& column_scale() const { return column_scale_; }

private:
  void take_values(const ActionRows& rows, std::span<const Expression> formulas, double h,
                   const ActionRows::Probe& probe) {
    std::mt19937_64 random(45);
    const int d = rows.system().field_count();
    values_.clear();
    for (int state = 0; state < states; ++state) {
      std::map<std::pair<NodeInput::Kind, int>, double> known;
      values_.push_back(rows.values(formulas, [&](const NodeInput& input) {
        if (input.kind == NodeInput::Kind::uniform) {
          return input.number == NodeVariation::number_of_h ? h : 1.0 / h;
        }
        const bool is_field = input.kind == NodeInput::Kind::node && input.number < 2 * d;
        const int field = is_field ? input.number % d : -1;
        const auto of = [&](int number) {
          return known.try_emplace({input.kind, number}, probe.draw(random, field)).first->second;
        };
        // Where fields are near each other, levels are by the step.
        return !is_field || input.number < d || !probe.is_narrow()
                   ? of(input.number)
                   : of(field) + h * (of(input.number) - probe.centres[static_cast<std::size_t>(field)]);
      }));
    }
  }
  [[nodiscard]] MatrixXcd symbol(int state, const std::array<double, 3>& wave) const {
    MatrixXcd matrix = MatrixXcd::Zero(size_, size_);
    for (std::size_t e = 0; e < entries_.size(); ++e) {
      const ActionEquations::Entry& entry = entries_[e];
      double phase = 0.0;
      for (std::size_t a = 0; a < wave.size(); ++a) {
        phase += wave[a] * entry.offset[a];
      }
      matrix(entry.row, entry.column) += values_[static_cast<std::size_t>(state)][e] * std::polar(1.0, phase);
    }
    return row_scale_.asDiagonal() * matrix * column_scale_.asDiagonal();
  }
  /// Rows and columns to entries of at most about 1, in turns.
  void scale(const MatrixXd& sizes) {
    row_scale_ = column_scale_ = VectorXd::Ones(size_);
    constexpr int turns = 10;
    for (int turn = 0; turn < turns; ++turn) {
      for (Index i = 0; i < size_; ++i) {
        const double row = (sizes.row(i).transpose().array() * column_scale_.array()).maxCoeff() * row_scale_(i);
        row_scale_(i) /= row > 0.0 ? std::sqrt(row) : 1.0;
      }
      for (Index j = 0; j < size_; ++j) {
        const double column = (sizes.col(j).array() * row_scale_.array()).maxCoeff() * column_scale_(j);
        column_scale_(j) /= column > 0.0 ? std::sqrt(column) : 1.0;
      }
    }
  }

  const std::vector<ActionEquations::Entry>& entries_;
  Index size_;
  std::vector<std::vector<double>> values_;
  VectorXd row_scale_, column_scale_;
};

/// An orthonormal basis, of scaled vectors.
MatrixXcd kernel_of(const MatrixXcd& matrix) {
  const auto [values, vectors] = solve::singular_values(matrix);
  return vectors.rightCols((values.array() < threshold).count());
}

/// Fields to be held, one for each vector of a real basis: bare potentials before those of the slab, these before
/// others, and of several the one with the largest share.
std::vector<int> pins_of(const ActionRows& rows, const ActionEquations& equations, MatrixXd basis) {
  const FieldStructure& structure = rows.system().structure();
  std::vector<int> pins;
  for (Index turn = 0, count = basis.cols(); turn < count; ++turn) {
    int best = -1;
    Index column = 0;
    double largest = 0.0;
    for (std::size_t i = 0; i < equations.fields.size(); ++i) {
      const int f = equations.fields[i];
      const double preferred = structure.potential[static_cast<std::size_t>(f)] ? 1e6
                               : structure.at_midpoints(f)                      ? 1e3
                                                                                : 1.0;
      for (Index c = turn; c < basis.cols(); ++c) {
        const double share = std::abs(basis(static_cast<Index>(i), c));
        if (share > 1e-7 && share * preferred > largest) {
          largest = share * preferred;
          best = static_cast<int>(i);
          column = c;
        }
      }
    }
    basis.col(turn).swap(basis.col(column));
    for (Index c = turn + 1; c < basis.cols(); ++c) {
      basis.col(c) -= basis(best, c) / basis(best, turn) * basis.col(turn);
    }
    pins.push_back(best);
  }
  return pins;
}

/// A real basis of a space of complex vectors that has one.
MatrixXd real_basis(const MatrixXcd& basis) {
  MatrixXd both(basis.rows(), 2 * basis.cols());
  both << basis.real(), basis.imag();
  return solve::singular_values(MatrixXd(both.transpose())).vectors.leftCols(basis.cols());
}

std::string fields_of(const ActionRows& rows, const ActionEquations& equations, const MatrixXcd& basis) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < equations.fields.size(); ++i) {
    if (basis.row(static_cast<Index>(i)).cwiseAbs().maxCoeff() > 1e-6) {
      names.push_back(rows.system().fields()[static_cast<std::size_t>(equations.fields[i])]);
    }
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

ActionEquations action_equations(const ActionRows& rows, std::vector<int> fields, std::vector<Expression> of_fields) {
  ActionEquations equations{.fields = std::move(fields), .rows = std::move(of_fields), .entries = {}};
  const int d = rows.system().field_count();
  std::vector<int> column(static_cast<std::size_t>(d), -1);
  for (std::size_t i = 0; i < equations.fields.size(); ++i) {
    column[static_cast<std::size_t>(equations.fields[i])] = static_cast<int>(i);
  }
  for (std::size_t i = 0; i < equations.rows.size(); ++i) {
    std::vector<NodeInput> inputs = rows.upper_inputs(equations.rows[i]);
    std::erase_if(inputs,
                  [&](const NodeInput& input) { return column[static_cast<std::size_t>(input.number - d)] < 0; });
    std::vector<Expression> variables;
    for (const NodeInput& input : inputs) {
      variables.push_back(input.variable);
    }
    const std::vector<Expression> first = formula::gradient(equations.rows[i], variables);
    for (std::size_t j = 0; j < first.size(); ++j) {
      if (!first[j].is_constant() || first[j].constant_value() != 0.0) {
        equations.entries.push_back(
            {static_cast<int>(i), column[static_cast<std::size_t>(inputs[j].number - d)], inputs[j].offset, first[j]});
      }
    }
  }
  return equations;
}

ActionKernel find_kernel(const ActionRows& rows, const ActionEquations& equations, double h) {
  const Symbols symbols(rows, equations, h);
  const int n = rows.grid().dimensions();
  constexpr std::array<double, 3> generic = {0.7, 1.1, 1.7};
  if (const MatrixXcd free = kernel_of(symbols.stacked(generic)); free.cols() > 0) {
    throw std::invalid_argument(fmt::format(
        "L does not determine {} at the next level: its variation by the values of a level leaves {} free. "
        "Let L depend on them at both levels, or leave a field that follows from others out of L",
        fields_of(rows, equations, free), free.cols() == 1 ? "a combination of them" : "combinations of them"));
  }
  ActionKernel kernel{.modes = {}, .rows = {}, .units = symbols.column_scale()};
  for (int a = 0; n > 1 && a < n; ++a) {
    for (const bool sawtooth : {false, true}) {
      std::array<double, 3> line = generic;
      line[static_cast<std::size_t>(a)] = sawtooth ? std::numbers::pi : 0.0;
      const MatrixXcd right = kernel_of(symbols.stacked(line));
      if (right.cols() == 0 || (sawtooth && rows.grid().cells(a) % 2 != 0)) {
        continue;
      }
      for (const int pin : pins_of(rows, equations, real_basis(right))) {
        KernelMode& mode = kernel.modes.emplace_back(KernelMode{{}, pin, a});
        mode.sawtooth[static_cast<std::size_t>(a)] = sawtooth;
      }
    }
  }
  for (int corner = 0; corner < 1 << n; ++corner) {
    std::array<bool, 3> sawtooth{};
    std::array<double, 3> wave{};
    bool fits = true;
    for (int a = 0; a < n; ++a) {
      const auto i = static_cast<std::size_t>(a);
      sawtooth[i] = (corner >> a & 1) != 0;
      wave[i] = sawtooth[i] ? std::numbers::pi : 0.0;
      fits = fits && (!sawtooth[i] || rows.grid().cells(a) % 2 == 0);
    }
    if (!fits) {
      continue;
    }
    const MatrixXcd right = kernel_of(symbols.stacked(wave)), left = kernel_of(symbols.transposed(wave));
    if (right.cols() != left.cols()) {
      throw std::invalid_argument(fmt::format(
          "L does not determine {} of {} at the next level, and no combination of its rows is free in turn: "
          "let L depend on them at both levels",
          corner == 0 ? "the mean" : "the sawtooth (-1)^i",
          fields_of(rows, equations, right.cols() > left.cols() ? right : left)));
    }
    if (right.cols() == 0) {
      continue;
    }
    const bool is_on_line = std::ranges::any_of(kernel.modes, [&](const KernelMode& mode) {
      return mode.line >= 0 &&
             mode.sawtooth[static_cast<std::size_t>(mode.line)] == sawtooth[static_cast<std::size_t>(mode.line)];
    });
    for (const int pin : pins_of(rows, equations, real_basis(right))) {
      if (!is_on_line) {
        kernel.modes.push_back({sawtooth, pin});
      }
    }
    const MatrixXd combinations = symbols.row_scale().asDiagonal() * real_basis(left);
    for (Index c = 0; c < combinations.cols(); ++c) {
      kernel.rows.push_back({sawtooth, combinations.col(c) / combinations.col(c).cwiseAbs().maxCoeff()});
    }
  }
  return kernel;
}

std::string describe(const KernelMode& mode, const ActionRows& rows, const ActionEquations& equations) {
  const int number = equations.fields[static_cast<std::size_t>(mode.pinned)];
  const std::string& field = rows.system().fields()[static_cast<std::size_t>(number)];
  std::vector<std::string> signs;
  for (std::size_t a = 0; a < mode.sawtooth.size(); ++a) {
    if (mode.sawtooth[a]) {
      signs.push_back(fmt::format("(-1)^{}", "ijk"[a]));
    }
  }
  const std::string along = mode.line < 0 ? std::string() : fmt::format(" along {}", rows.grid().axis(mode.line).name);
  return signs.empty() ? fmt::format("the mean of {}{}", field, along)
                       : fmt::format("the sawtooth {} of {}{}", fmt::join(signs, " "), field, along);
}

}  // namespace rubato
