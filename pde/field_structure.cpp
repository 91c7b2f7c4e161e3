#include <rubato/pde/field_structure.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numeric>
#include <stdexcept>
#include <string>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/random_points.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::field_structure;

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Fields and equations have units of their own (c² of a wave equation may be 1 or 9e16): ranks are those of the matrix
/// with its rows and columns scaled until the largest entry of each is about 1 (Ruiz), by powers of two. Rows and
/// columns that are 0 have to be exactly 0.
template <typename Matrix>
Matrix null_space_of(Matrix matrix) {
  const Index columns = matrix.cols();
  if (matrix.rows() == 0 || columns == 0) {
    return Matrix::Identity(columns, columns);
  }
  const solve::Equilibration equilibration = solve::equilibrate(matrix.cwiseAbs());
  const VectorXd& scale = equilibration.columns;
  matrix = (equilibration.rows.asDiagonal() * matrix * scale.asDiagonal()).eval();
  const auto [values, vectors] = solve::singular_values(matrix);
  Index rank = 0;
  while (rank < values.size() && values[rank] > rank_threshold * values[0]) {
    ++rank;
  }
  if (rank == columns) {
    return Matrix(columns, 0);
  }
  using Scalar = typename Matrix::Scalar;
  const Matrix scaled = vectors.rightCols(columns - rank).unaryExpr([](const Scalar& x) {
    return std::abs(x) < rank_threshold ? Scalar(0.0) : x;
  });
  Matrix null = scale.asDiagonal() * scaled;
  // Gram and Schmidt's method, twice: it leaves rows of zeros what they are.
  for (Index c = 0; c < null.cols(); ++c) {
    null.col(c).normalize();
    for (int pass = 0; pass < 2; ++pass) {
      for (Index earlier = 0; earlier < c; ++earlier) {
        const auto overlap = null.col(earlier).dot(null.col(c));
        null.col(c) -= overlap * null.col(earlier);
      }
      null.col(c).normalize();
    }
  }
  return null;
}

/// AᵀBC, with entries that are nothing but rounding of their terms set to 0.
MatrixXcd product(const MatrixXcd& A, const MatrixXcd& B, const MatrixXcd& C) {
  MatrixXcd result = solve::product(solve::product(A.transpose(), B), C);
  const MatrixXd terms = solve::product(solve::product(A.transpose().cwiseAbs(), B.cwiseAbs()), C.cwiseAbs());
  for (Index i = 0; i < result.size(); ++i) {
    if (std::abs(result(i)) <= cancelled * terms(i)) {
      result(i) = 0.0;
    }
  }
  return result;
}

/// Fields that occur in some vector of the space spanned by the columns.
template <typename Matrix>
std::vector<bool> support(const Matrix& basis) {
  std::vector<bool> result(static_cast<std::size_t>(basis.rows()), false);
  for (Index f = 0; f < basis.rows(); ++f) {
    result[static_cast<std::size_t>(f)] = basis.cols() > 0 && basis.row(f).norm() > cancelled;
  }
  return result;
}

/// Σ iκ_a K_a - S'' at random wave numbers: what the equations in space are on one wave.
MatrixXcd generic_symbol(const MultisymplecticSystem& system, const MatrixXd& hessian, std::mt19937_64& random) {
  std::uniform_real_distribution<double> wave(0.5, 1.5);
  MatrixXcd symbol = -hessian.cast<std::complex<double>>();
  for (int a = 0; a < system.directions(); ++a) {
    symbol += std::complex<double>(0.0, wave(random)) * system.K(a).cast<std::complex<double>>();
  }
  return symbol;
}

/// True if the entry of two fields in M₊ or K₊ is in the row of `field`, in the column of `other`, by what they are.
bool has_row(const FieldStructure& structure, Index field, Index other) {
  const auto f = static_cast<std::size_t>(field), o = static_cast<std::size_t>(other);
  return structure.potential[f] != structure.potential[o] ? structure.potential[f]
                                                          : structure.algebraic[o] && !structure.algebraic[f];
}

/// On which side of a difference each field stands, 0 or 1, so that fields which K joins stand on two sides and those
/// which M joins on one: differences δ⁺ and δ⁻ of the rows are those of a staggered grid then, with the symbols of a
/// skew operator but for half a cell. Fields for which that cannot be stand on either.
std::vector<int> sides_of(const MatrixXd& M, const MatrixXd& K, const FieldStructure& structure) {
  constexpr int open = -1;
  std::vector<int> sides(static_cast<std::size_t>(K.rows()), open);
  std::vector<Index> next;
  const auto set = [&](Index field, int side) {
    if (int& of_field = sides[static_cast<std::size_t>(field)]; of_field == open) {
      of_field = side;
      next.push_back(field);
    }
  };
  const auto go_on = [&] {
    while (!next.empty()) {
      const Index field = next.back();
      next.pop_back();
      const int side = sides[static_cast<std::size_t>(field)];
      for (Index other = 0; other < K.rows(); ++other) {
        if (M(field, other) != 0.0) {
          set(other, side);
        } else if (K(field, other) != 0.0) {
          set(other, 1 - side);
        }
      }
    }
  };
  for (const bool is_given : {true, false}) {
    for (Index i = 0; i < K.rows(); ++i) {
      for (Index j = 0; j < K.rows(); ++j) {
        if (K(i, j) != 0.0 && (!is_given || has_row(structure, i, j))) {
          set(i, 0);
          go_on();
        }
      }
    }
  }
  return sides;
}

/// Two fields on one side have half of their entry each: differences of them are central.
MatrixXd split(const MatrixXd& matrix, const FieldStructure& structure, const std::vector<int>& sides) {
  const Index d = matrix.rows();
  MatrixXd plus = MatrixXd::Zero(d, d);
  for (Index i = 0; i < d; ++i) {
    for (Index j = i + 1; j < d; ++j) {
      const bool is_given = has_row(structure, i, j) || has_row(structure, j, i);
      const int first = sides[static_cast<std::size_t>(i)], second = sides[static_cast<std::size_t>(j)];
      const double of_first =
          is_given ? (has_row(structure, i, j) ? 1.0 : 0.0) : (first == second ? 0.5 : (first < second ? 1.0 : 0.0));
      plus(i, j) = of_first * matrix(i, j);
      plus(j, i) = (1.0 - of_first) * matrix(j, i);
    }
  }
  return plus;
}

void refuse_undetermined(const MultisymplecticSystem& system, const MatrixXd& hessian, std::mt19937_64& random) {
  std::uniform_real_distribution<double> rate(0.5, 1.5);
  MatrixXcd symbol = generic_symbol(system, hessian, random);
  symbol += rate(random) * system.M().cast<std::complex<double>>();
  const MatrixXcd null = null_space(symbol);
  if (null.cols() == 0) {
    return;
  }
  std::vector<std::string> names;
  const auto in_support = support(null);
  for (std::size_t f = 0; f < in_support.size(); ++f) {
    if (in_support[f]) {
      names.push_back(system.fields()[f]);
    }
  }
  throw std::invalid_argument(fmt::format(
      fmt::runtime(
          names.size() == 1
              ? "the field {} is not determined: its rows of M and K and its part of S leave it free"
              : "the fields {} are not determined: the equations leave a combination of them free (a gauge); leave "
                "one of them out, or give it an equation"),
      fmt::join(names, ", ")));
}

/// Waves across x alone on which the equations leave fields free, whatever the rate: u_yyt, u = φ_x, has φ + f(y, t)
/// with φ. They may be held where derivatives do not see them, or see them as D = sM, as in a frame that moves.
void refuse_undetermined_across(const MultisymplecticSystem& system, std::mt19937_64& random) {
  const Index d = system.field_count();
  constexpr int samples = 3;
  std::uniform_real_distribution<double> wave(0.5, 1.5);
  for (int a = 1; a < system.directions(); ++a) {
    const MatrixXcd M = system.M().cast<std::complex<double>>();
    const MatrixXcd D = std::complex<double>(0.0, wave(random)) * system.K(a).cast<std::complex<double>>();
    const double rate = wave(random);
    MatrixXcd symbols(samples * d, d);
    for (int s = 0; s < samples; ++s) {
      symbols.middleRows(s * d, d) = rate * M + D - generic_hessian(system, random).cast<std::complex<double>>();
    }
    const MatrixXcd free = null_space(symbols), moved = solve::product(M, free), seen = solve::product(D, free);
    MatrixXcd both(d, 2 * free.cols());
    both << moved, seen;
    if (free.cols() == 0 || rank(both) == rank(moved)) {
      continue;
    }
    std::vector<std::string> names;
    const auto in_support = support(free);
    for (std::size_t f = 0; f < in_support.size(); ++f) {
      if (in_support[f] && !system.K(a).col(static_cast<Index>(f)).isZero(0.0)) {
        names.push_back(system.fields()[f]);
      }
    }
    const char y = "xyz"[a];
    throw std::invalid_argument(fmt::format(
        "on waves across x, functions of {0} and t alone, the equations leave {1} free, and derivatives by {0} see "
        "that: no step is determined. A derivative by {0} and t, such as u_{0}{0}t beside u_t, does this: leave it "
        "out. "
        "(With derivatives by x alone, (1 - dxx) u_t = dx(dH/du), H with structure = \"dx/(1-dxx)\" has a step)",
        y, fmt::join(names, ", ")));
  }
}

/// Constant vectors b with b·∇S = 0, from gradients at random points.
MatrixXd find_affine_symmetries(const MultisymplecticSystem& system, std::mt19937_64& random) {
  const Index d = system.field_count();
  std::vector<formula::ScalarEvaluator> potentials = potentials_on_branches(system);
  std::vector<double> z(system.variables().size());
  std::vector<double> outputs(1 + system.fields().size() + system.coordinates().size());
  MatrixXd gradients = MatrixXd::Zero(4 * d, d);
  std::uniform_real_distribution<double> value(0.1, 1.4);
  Index row = 0;
  for (int attempt = 0; attempt < 40 * d && row < gradients.rows(); ++attempt) {
    for (double& component : z) {
      component = attempt % 2 == 0 ? value(random) : value(random) - 0.75;
    }
    potentials[static_cast<std::size_t>(attempt / 2) % potentials.size()](z, outputs);
    const Eigen::Map<const VectorXd> gradient(outputs.data() + 1, d);
    if (gradient.allFinite()) {
      gradients.row(row++) = gradient.transpose();
    }
  }
  if (row < gradients.rows()) {  // S is finite almost nowhere near 0: only the fields that do not occur are certain
    const auto used = formula::variables_of(system.expression());
    gradients.setIdentity(d, d);
    for (Index f = 0; f < d; ++f) {
      const auto number = system.graph()->node(system.variables()[static_cast<std::size_t>(f)].index()).a;
      gradients(f, f) = std::ranges::find(used, number) == used.end() ? 0.0 : 1.0;
    }
  }
  return gradients.isZero(0.0) ? MatrixXd::Identity(d, d) : column_echelon(null_space(gradients));
}

/// The columns of `candidates` for which keep(column) holds.
template <typename Keep>
MatrixXd select(const MatrixXd& candidates, Keep&& keep) {
  MatrixXd result(candidates.rows(), 0);
  for (Index c = 0; c < candidates.cols(); ++c) {
    if (keep(candidates.col(c))) {
      result.conservativeResize(Eigen::NoChange, result.cols() + 1);
      result.col(result.cols() - 1) = candidates.col(c);
    }
  }
  return result;
}

/// The names of the fields that ∂²S/∂z_f∂z_g depends on.
std::vector<std::string> fields_in_entry(const MultisymplecticSystem& system, Index f, Index g) {
  const std::span<const formula::Expression> z(system.variables().data(), system.fields().size());
  const auto slopes = formula::gradient(system.expression(), z);
  const auto row = formula::gradient(slopes[static_cast<std::size_t>(f)], z);
  std::vector<std::string> names;
  for (const std::size_t variable : formula::variables_of(row[static_cast<std::size_t>(g)])) {
    if (const std::string& name = system.graph()->variable_name(variable);
        std::ranges::find(system.fields(), name) != system.fields().end()) {
      names.push_back(name);
    }
  }
  return names;
}

/// The energy of a level holds S with all its fields. One that exists at midpoints only drops out if S is linear in it:
/// its factor is then what its row says of the other fields, and vanishes.
void refuse_nonlinear_at_levels(const MultisymplecticSystem& system, const MatrixXd& hessian,
                                const FieldStructure& structure) {
  for (Index f = 0; f < hessian.rows(); ++f) {
    for (Index g = 0; g <= f; ++g) {
      const auto i = static_cast<std::size_t>(f);
      if (structure.nonlinear[i] && structure.nonlinear[static_cast<std::size_t>(g)] && hessian(f, g) != 0.0) {
        const std::vector<std::string> names = fields_in_entry(system, f, g);
        const bool is_linear = !names.empty() && std::ranges::none_of(names, [&](const std::string& name) {
          return structure.nonlinear[static_cast<std::size_t>(system.field(name))];
        });
        if (is_linear) {
          throw std::invalid_argument(fmt::format(
              "the constraint that determines {0} has a coefficient that depends on {1}: the scheme knows {0} in the "
              "middle of steps only, and the energy of a level would need it there; choose fields for which the "
              "coefficient is constant (where S holds c*{0}^2 and {0} comes from a field u: u/sqrt(c) in place of u)",
              system.fields()[i], fmt::join(names, ", ")));
        }
        throw std::invalid_argument(fmt::format(
            "the constraint that determines {0} is not linear, and S is not linear in {0}: schemes have {0} in the "
            "middle "
            "of steps only, and the energy of a level would need it there. A derivative such as u_t or u_x has to "
            "occur "
            "in L as a polynomial of degree two with constant coefficients; a field that no derivative by t moves, "
            "such "
            "as the mean flow beside psi, needs one of its own, or has to be put into S by what its row gives for it",
            system.fields()[i]));
      }
    }
  }
}

}  // namespace

MatrixXcd null_space(const MatrixXcd& matrix) {
  return null_space_of(matrix);
}
MatrixXd null_space(const MatrixXd& matrix) {
  return null_space_of(matrix);
}
Index rank(const MatrixXcd& matrix) {
  return matrix.cols() - null_space_of(matrix).cols();
}

MatrixXd generic_hessian(const MultisymplecticSystem& system, std::mt19937_64& random) {
  std::uniform_real_distribution<double> value(0.1, 1.4);
  std::vector<double> z(system.variables().size());
  for (int attempt = 0; attempt < 40; ++attempt) {
    for (double& component : z) {
      component = attempt % 2 == 0 ? value(random) : value(random) - 0.75;
    }
    MatrixXd hessian = system.hessian(z);
    if (hessian.allFinite()) {
      return hessian;
    }
  }
  MatrixXd hessian = system.constant_hessian();
  for (const auto [row, column] : system.varying_hessian()) {
    hessian(row, column) = hessian(column, row) = value(random);
  }
  return hessian;
}

MatrixXd column_echelon(MatrixXd basis) {
  Index column = 0;
  for (Index row = 0; row < basis.rows() && column < basis.cols(); ++row) {
    Index pivot = 0;
    if (basis.row(row).tail(basis.cols() - column).cwiseAbs().maxCoeff(&pivot) < support_threshold) {
      continue;
    }
    basis.col(column).swap(basis.col(column + pivot));
    basis.col(column) /= basis(row, column);
    for (Index other = 0; other < basis.cols(); ++other) {
      if (other != column) {
        basis.col(other) -= basis(row, other) * basis.col(column);
      }
    }
    ++column;
  }
  return basis.unaryExpr([](double x) { return std::abs(x) < 1e-9 ? 0.0 : x; });
}

FieldStructure analyse(const MultisymplecticSystem& system) {
  std::mt19937_64 random(20);  // any seed: the exceptional points have measure zero
  const MatrixXd hessian = generic_hessian(system, random);
  refuse_undetermined(system, hessian, random);
  std::mt19937_64 others(21);
  refuse_undetermined_across(system, others);

  const Index d = system.field_count();
  FieldStructure result;
  result.kernel = system.M().isZero(0.0) ? MatrixXd::Identity(d, d) : column_echelon(null_space(system.M()));
  result.affine_symmetries = find_affine_symmetries(system, random);
  const auto used = formula::variables_of(system.expression());
  for (Index f = 0; f < d; ++f) {
    const auto number = system.graph()->node(system.variables()[static_cast<std::size_t>(f)].index()).a;
    result.algebraic.push_back(system.M().col(f).isZero(0.0));
    result.potential.push_back(std::ranges::find(used, number) == used.end());
  }

  // On one wave, the constraints of a level act on its part in ker M by nᵀ(iκK - S'')n'.
  const MatrixXcd kernel = result.kernel.cast<std::complex<double>>();
  const MatrixXcd symbol = generic_symbol(system, hessian, random);
  const MatrixXcd undetermined = solve::product(kernel, null_space(product(kernel, symbol, kernel)));
  result.multiplier = support(undetermined);

  result.level_constraints = select(result.kernel, [&](const auto& n) {
    const MatrixXcd row = product(n.template cast<std::complex<double>>(), symbol, MatrixXcd::Identity(d, d));
    for (Index f = 0; f < d; ++f) {
      if (result.multiplier[static_cast<std::size_t>(f)] && row(0, f) != 0.0) {
        return false;
      }
    }
    return !row.isZero(0.0);
  });

  const MatrixXd linear = select(result.level_constraints, [&](const auto& n) {
    for (const auto [row, column] : system.nonlinear_hessian()) {
      if (n[row] != 0.0 || n[column] != 0.0) {
        return false;
      }
    }
    return true;
  });
  const MatrixXcd determined_linearly = product(linear.cast<std::complex<double>>(), symbol, kernel);
  const auto rest = support(solve::product(kernel, null_space(determined_linearly)));
  result.nonlinear.assign(static_cast<std::size_t>(d), false);
  for (Index f = 0; f < d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    result.nonlinear[i] = rest[i] && !result.multiplier[i];
    if (rest[i] && !result.algebraic[i]) {
      throw std::invalid_argument(
          fmt::format("a constraint that is not linear binds a combination of fields that holds {0}, which has an "
                      "equation of motion of its own; choose fields in which {0} does not occur in the kernel of M",
                      system.fields()[i]));
    }
  }

  refuse_nonlinear_at_levels(system, hessian, result);

  std::vector<int> in_order(static_cast<std::size_t>(d));
  std::iota(in_order.begin(), in_order.end(), 0);
  result.M_plus = split(system.M(), result, in_order);
  for (int a = 0; a < system.directions(); ++a) {
    result.K_plus.push_back(split(system.K(a), result, sides_of(system.M(), system.K(a), result)));
  }
  return result;
}

}  // namespace rubato
