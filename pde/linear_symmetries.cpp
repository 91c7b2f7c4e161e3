#include <rubato/pde/linear_symmetries.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <random>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/pde/field_structure.hpp>
#include <rubato/pde/random_points.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Relative to what is compared, in the units in which it is found.
constexpr double no_rounding = 1e-9;

VectorXd flat(const MatrixXd& B) {
  return B.transpose().reshaped();
}

/// (MB)_ij = (MB)_ji for i < j, as rows of equations for the entries of B.
void require_symmetric(const MatrixXd& M, std::vector<VectorXd>& equations) {
  const Index d = M.rows();
  for (Index i = 0; i < d; ++i) {
    for (Index j = 0; j < i; ++j) {
      VectorXd row = VectorXd::Zero(d * d);
      for (Index k = 0; k < d; ++k) {
        row(k * d + j) += M(i, k);
        row(k * d + i) -= M(j, k);
      }
      if (!row.isZero(0.0)) {
        equations.push_back(row.normalized());
      }
    }
  }
}

/// Terms of S that differ by no more digits than that are seen with each other: rounding decides far below.
constexpr double most_uneven = 0x1p10;

/// The mean of ln |term| for each term of S, by the sizes of fields.
class TermSizes {
public:
  explicit TermSizes(const MultisymplecticSystem& system)
      : fields_(system.field_count()), terms_(formula::terms_of(system.expression())) {
    evaluate_ = formula::ScalarEvaluator(formula::Bytecode(terms_, system.variables()));
    values_.resize(terms_.size());
    std::mt19937_64 random(53);
    std::uniform_real_distribution<double> value(0.1, 1.4);
    std::bernoulli_distribution sign;
    for (VectorXd& point : points_) {
      // Fields of one size: those that enter a term alike count alike.
      point = VectorXd::Constant(static_cast<Index>(system.variables().size()), value(random));
      point = point.unaryExpr([&](double x) { return sign(random) ? x : -x; }).eval();
    }
  }

  [[nodiscard]] const std::vector<formula::Expression>& terms() const { return terms_; }

  /// NaN for a term that is undefined, or 0, at all points.
  [[nodiscard]] VectorXd logarithms(const VectorXd& sizes) {
    const auto count = static_cast<Index>(terms_.size());
    VectorXd sums = VectorXd::Zero(count), counts = VectorXd::Zero(count);
    for (VectorXd point : points_) {
      point.head(fields_).array() *= sizes.array();
      evaluate_({point.data(), static_cast<std::size_t>(point.size())}, values_);
      for (Index a = 0; a < count; ++a) {
        if (const double logarithm = std::log(std::abs(values_[static_cast<std::size_t>(a)]));
            std::isfinite(logarithm)) {
          sums(a) += logarithm;
          counts(a) += 1.0;
        }
      }
    }
    return sums.cwiseQuotient(counts);
  }

private:
  Index fields_;
  std::vector<formula::Expression> terms_;
  formula::ScalarEvaluator evaluate_;
  std::vector<double> values_;
  std::array<VectorXd, 32> points_;
};

/// Fields that occur in the same terms of S, as a matrix with a column of zeros and ones for each such set: they change
/// together, since a sum such as x² + y² shows only the larger of its parts. One that S does not name is alone.
MatrixXd alike(const MultisymplecticSystem& system, const std::vector<formula::Expression>& terms) {
  std::map<std::vector<bool>, std::vector<Index>> sets;
  for (Index f = 0; f < system.field_count(); ++f) {
    const auto number = system.graph()->node(system.variables()[static_cast<std::size_t>(f)].index()).a;
    std::vector<bool> occurs;
    for (const formula::Expression& term : terms) {
      const auto used = formula::variables_of(term);
      occurs.push_back(std::ranges::find(used, number) != used.end());
    }
    if (std::ranges::find(occurs, true) == occurs.end()) {
      occurs.resize(terms.size() + static_cast<std::size_t>(f) + 1);
    }
    sets[occurs].push_back(f);
  }
  MatrixXd result = MatrixXd::Zero(system.field_count(), static_cast<Index>(sets.size()));
  Index column = 0;
  for (const auto& [occurs, fields] : sets) {
    for (const Index f : fields) {
      result(f, column) = 1.0;
    }
    ++column;
  }
  return result;
}

/// log₂ of what should be even, by exponents of the fields' sets, and the derivatives by these.
struct Evenness {
  std::vector<double> logarithms;
  std::vector<VectorXd> slopes;

  /// Less their means. \return how many digits they differ by
  double centre(std::size_t from) {
    const auto count = static_cast<double>(logarithms.size() - from);
    double mean = 0.0, least = std::numeric_limits<double>::infinity(), largest = -least;
    VectorXd mean_slope = VectorXd::Zero(count > 0.0 ? slopes[from].size() : 0);
    for (std::size_t i = from; i < logarithms.size(); ++i) {
      mean += logarithms[i] / count;
      mean_slope += slopes[i] / count;
      least = std::min(least, logarithms[i]);
      largest = std::max(largest, logarithms[i]);
    }
    for (std::size_t i = from; i < logarithms.size(); ++i) {
      logarithms[i] -= mean;
      slopes[i] -= mean_slope;
    }
    return count > 0.0 ? largest - least : 0.0;
  }
};

/// Powers of 2 at which the terms of S are about equally large, and the entries of M and of each K with each other, as
/// far as sizes of fields can make them so. Where one term is less than the rounding error of another (kinetic energies
/// of 1e-25 p² beside 1e45/r), random points of size 1 do not see it. By Newton's method for the logarithms, with the
/// least changes; all 1 where terms and entries are even.
VectorXd even_sizes(const MultisymplecticSystem& system) {
  constexpr int most_iterations = 12;
  constexpr double largest_change = 64.0;
  TermSizes sizes_of(system);
  const MatrixXd sets = alike(system, sizes_of.terms());
  VectorXd exponents = VectorXd::Zero(system.field_count()), best = exponents;
  double least = std::numeric_limits<double>::infinity();
  const auto logarithms = [&](const VectorXd& at) {
    return VectorXd(sizes_of.logarithms(at.unaryExpr([](double x) { return std::exp2(x); })) / std::numbers::ln2);
  };
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    Evenness even;
    const VectorXd here = logarithms(exponents);
    MatrixXd slopes(here.size(), sets.cols());
    for (Index s = 0; s < sets.cols(); ++s) {
      slopes.col(s) = logarithms(exponents + sets.col(s)) - here;
    }
    for (Index a = 0; a < here.size(); ++a) {
      if (std::isfinite(here(a)) && slopes.row(a).allFinite()) {
        even.logarithms.push_back(here(a));
        even.slopes.push_back(slopes.row(a).transpose());
      }
    }
    double spread = even.centre(0);
    const auto add_entries = [&](const MatrixXd& matrix) {
      const std::size_t from = even.logarithms.size();
      for (Index i = 0; i < matrix.rows(); ++i) {
        for (Index j = 0; j < i; ++j) {
          if (matrix(i, j) != 0.0) {
            even.logarithms.push_back(std::log2(std::abs(matrix(i, j))) + exponents(i) + exponents(j));
            even.slopes.push_back((sets.row(i) + sets.row(j)).transpose());
          }
        }
      }
      spread = std::max(spread, even.centre(from));
    };
    add_entries(system.M());
    for (int a = 0; a < system.directions(); ++a) {
      add_entries(system.K(a));
    }
    if (spread < least) {
      least = spread;
      best = exponents;
    }
    if (spread <= std::log2(most_uneven)) {
      break;
    }
    MatrixXd slope(static_cast<Index>(even.slopes.size()), sets.cols());
    for (std::size_t i = 0; i < even.slopes.size(); ++i) {
      slope.row(static_cast<Index>(i)) = even.slopes[i].transpose();
    }
    const Eigen::Map<const VectorXd> uneven(even.logarithms.data(), slope.rows());
    const VectorXd change = solve::least_squares(slope, -uneven);
    exponents += sets * change.cwiseMax(-largest_change).cwiseMin(largest_change);
    exponents = exponents.array().round();
  }
  return best.unaryExpr([](double x) { return std::exp2(x); });
}

/// Columns less their projections on `known`.
MatrixXd without(MatrixXd columns, const std::vector<MatrixXd>& known) {
  if (known.empty()) {
    return columns;
  }
  MatrixXd given(columns.rows(), static_cast<Index>(known.size()));
  for (std::size_t i = 0; i < known.size(); ++i) {
    given.col(static_cast<Index>(i)) = flat(known[i]);
  }
  return columns - solve::product(given, solve::least_squares(given, columns));
}

}  // namespace

LinearSymmetries::LinearSymmetries(const MultisymplecticSystem& system)
    : fields_(system.field_count()), units_(even_sizes(system)) {
  const Index d = fields_;
  std::vector<VectorXd> equations;
  const auto in_units = [this](const MatrixXd& M) { return MatrixXd(units_.asDiagonal() * M * units_.asDiagonal()); };
  require_symmetric(in_units(system.M()), equations);
  for (int a = 0; a < system.directions(); ++a) {
    require_symmetric(in_units(system.K(a)), equations);
  }
  for (const PotentialSample& sample : samples_of(system, 2 * d * d, units_)) {
    const VectorXd gradient = sample.gradient.cwiseProduct(units_);
    const VectorXd row = flat(gradient * sample.point.head(d).cwiseQuotient(units_).transpose());
    if (row.norm() > 0.0) {
      equations.push_back(row.normalized());
    }
  }
  MatrixXd matrix(static_cast<Index>(equations.size()), d * d);
  for (std::size_t i = 0; i < equations.size(); ++i) {
    matrix.row(static_cast<Index>(i)) = equations[i].transpose();
  }
  basis_ = null_space(matrix);
}

MatrixXd LinearSymmetries::in_fields(const VectorXd& column) const {
  const MatrixXd B = column.reshaped(fields_, fields_).transpose();
  return (units_.asDiagonal() * B * units_.cwiseInverse().asDiagonal()).unaryExpr(&nearest_twelfth);
}

std::vector<MatrixXd> LinearSymmetries::beside(const std::vector<MatrixXd>& known) const {
  std::vector<MatrixXd> result;
  if (basis_.cols() == 0) {
    return result;
  }
  std::vector<MatrixXd> known_in_units;
  for (const MatrixXd& B : known) {
    known_in_units.push_back(units_.cwiseInverse().asDiagonal() * B * units_.asDiagonal());
  }
  const MatrixXd columns = column_echelon(without(basis_, known_in_units));
  for (Index i = 0; i < columns.cols(); ++i) {
    if (columns.col(i).norm() <= no_rounding) {
      continue;
    }
    // In reduced echelon form the first entry is 1: in units, and here in those of the fields.
    Index first = 0;
    while (columns(first, i) == 0.0) {
      ++first;
    }
    result.push_back(in_fields(columns.col(i) * units_(first % fields_) / units_(first / fields_)));
  }
  return result;
}

bool LinearSymmetries::is_beside(const MatrixXd& B, const std::vector<MatrixXd>& known) {
  return without(flat(B), known).norm() > no_rounding * B.norm();
}

std::optional<MatrixXd> LinearSymmetries::phase(int p, int q) const {
  const Index d = fields_;
  MatrixXd rows(2 * d, basis_.cols());
  VectorXd wanted = VectorXd::Zero(2 * d);
  wanted(q) = -units_(q) / units_(p);
  wanted(d + p) = units_(p) / units_(q);
  rows.topRows(d) = basis_.middleRows(p * d, d);
  rows.bottomRows(d) = basis_.middleRows(q * d, d);
  if (basis_.cols() == 0) {
    return std::nullopt;
  }
  const VectorXd weights = solve::least_squares(rows, wanted);
  if ((rows * weights - wanted).norm() > no_rounding * wanted.norm()) {
    return std::nullopt;
  }
  return in_fields(basis_ * weights);
}

}  // namespace rubato
