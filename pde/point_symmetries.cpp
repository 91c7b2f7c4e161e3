#include <rubato/pde/point_symmetries.hpp>

#include <algorithm>

#include <Eigen/Core>

#include <rubato/pde/field_structure.hpp>
#include <rubato/pde/linear_symmetries.hpp>
#include <rubato/pde/random_points.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double of_symmetries = 1e-9;  ///< relative to what is compared

const MatrixXd& matrix_of(const MultisymplecticSystem& system, int mu) {
  return mu == 0 ? system.M() : system.K(mu - 1);
}

}  // namespace

std::vector<Scaling> scalings(const MultisymplecticSystem& all) {
  const MultisymplecticSystem& system = all.without_constant();
  const Index d = system.field_count(), n = 1 + system.directions();
  const Index size = n + d + 1;  // exponents of t and x, of the fields, of the density
  std::vector<VectorXd> equations;
  for (Index mu = 0; mu < n; ++mu) {
    const MatrixXd& matrix = matrix_of(system, static_cast<int>(mu));
    for (Index i = 0; i < d; ++i) {
      for (Index j = 0; j < i; ++j) {
        if (matrix(i, j) != 0.0) {
          VectorXd row = VectorXd::Zero(size);
          row(n + i) = row(n + j) = 1.0;
          row(mu) = row(size - 1) = -1.0;
          equations.push_back(row);
        }
      }
    }
  }
  for (const PotentialSample& sample : samples_of(system, 3 * size)) {
    VectorXd row = VectorXd::Zero(size);
    row.segment(n, d) = sample.point.head(d).cwiseProduct(sample.gradient);
    for (std::size_t c = 0; c < system.coordinates().size(); ++c) {
      const auto i = static_cast<Index>(c);
      row(1 + system.coordinates()[c]) = sample.point(d + i) * sample.sources(i);
    }
    row(size - 1) = -sample.S;
    if (row.norm() > 0.0) {
      equations.push_back(row.normalized());
    }
  }
  MatrixXd matrix(static_cast<Index>(equations.size()), size);
  for (std::size_t i = 0; i < equations.size(); ++i) {
    matrix.row(static_cast<Index>(i)) = equations[i].transpose();
  }
  const MatrixXd kernel = null_space(matrix);
  std::vector<Scaling> result;
  if (kernel.cols() == 0) {
    return result;
  }
  const MatrixXd basis = column_echelon(kernel).unaryExpr(&nearest_twelfth);
  for (Index i = 0; i < basis.cols(); ++i) {
    result.push_back({basis.col(i).segment(n, d), basis.col(i).head(n), basis(size - 1, i)});
  }
  return result;
}

namespace {

/// The unknowns of a Galilei transformation: the entries of C and R by rows, c, the factors of linear symmetries and of
/// affine ones.
class GalileiEquations {
public:
  GalileiEquations(const MultisymplecticSystem& system, int direction)
      : system_(system),
        direction_(direction),
        d_(system.field_count()),
        linear_(LinearSymmetries(system).beside({})),
        affine_(system.structure().affine_symmetries),
        size_(2 * d_ * d_ + d_ + static_cast<Index>(linear_.size()) + affine_.cols()) {
    for (int mu = 0; mu <= system.directions(); ++mu) {
      require_derivatives(mu);
    }
    for (const PotentialSample& sample : samples_of(system, 2 * size_ / d_ + 4)) {
      require_values(sample);
    }
  }

  [[nodiscard]] std::optional<GalileiTransformation> solve() const {
    MatrixXd matrix(static_cast<Index>(rows_.size()), size_);
    VectorXd right(matrix.rows());
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      matrix.row(static_cast<Index>(i)) = rows_[i].transpose();
      right(static_cast<Index>(i)) = right_[i];
    }
    VectorXd x = solve::least_squares(matrix, right);
    // Less what else transforms solutions, such as the phase of psi, so that of δz as little as can be is left.
    if (const MatrixXd others = null_space(matrix); others.cols() > 0) {
      MatrixXd of_delta = others;
      of_delta.middleRows(d_ * d_, d_ * d_).setZero();  // R is free
      x -= others * solve::least_squares(of_delta, x);
    }
    if (!((matrix * x - right).norm() <= of_symmetries * right.norm())) {
      return std::nullopt;
    }
    GalileiTransformation found{direction_, MatrixXd::Zero(d_, d_), MatrixXd(d_, d_), VectorXd::Zero(d_), VectorXd(d_)};
    for (Index i = 0; i < d_; ++i) {
      for (Index j = 0; j < d_; ++j) {
        found.C(i, j) = x(C(i, j));
      }
      found.c(i) = x(c(i));
    }
    for (std::size_t k = 0; k < linear_.size(); ++k) {
      found.B += x(beta(k)) * linear_[k];
    }
    for (Index k = 0; k < affine_.cols(); ++k) {
      found.b += x(gamma(k)) * affine_.col(k);
    }
    for (MatrixXd* const part : {&found.B, &found.C}) {
      *part = part->unaryExpr(&nearest_twelfth);
    }
    for (VectorXd* const part : {&found.b, &found.c}) {
      *part = part->unaryExpr(&nearest_twelfth);
    }
    return found;
  }

private:
  [[nodiscard]] Index C(Index i, Index j) const { return i * d_ + j; }
  [[nodiscard]] Index R(Index i, Index j) const { return d_ * d_ + i * d_ + j; }
  [[nodiscard]] Index c(Index i) const { return 2 * d_ * d_ + i; }
  [[nodiscard]] Index beta(std::size_t k) const { return 2 * d_ * d_ + d_ + static_cast<Index>(k); }
  [[nodiscard]] Index gamma(Index k) const { return 2 * d_ * d_ + d_ + static_cast<Index>(linear_.size()) + k; }
  void add(VectorXd row, double right) {
    if (!row.isZero(0.0) || right != 0.0) {
      rows_.push_back(std::move(row));
      right_.push_back(right);
    }
  }

  /// Λ C - RΛ = M in the direction of the motion, else 0.
  void require_derivatives(int mu) {
    const MatrixXd& matrix = matrix_of(system_, mu);
    const bool moves = mu == 1 + direction_;
    for (Index i = 0; i < d_; ++i) {
      for (Index j = 0; j < d_; ++j) {
        VectorXd row = VectorXd::Zero(size_);
        for (Index k = 0; k < d_; ++k) {
          row(C(k, j)) += matrix(i, k);
          row(R(i, k)) -= matrix(k, j);
        }
        add(std::move(row), moves ? system_.M()(i, j) : 0.0);
      }
    }
  }
  /// K_a(Bz + b) - S''(z)(Cz + c) + R∇S(z) = 0.
  void require_values(const PotentialSample& sample) {
    const VectorXd z = sample.point.head(d_);
    const MatrixXd hessian = system_.hessian({sample.point.data(), static_cast<std::size_t>(sample.point.size())});
    const MatrixXd& K = system_.K(direction_);
    for (Index i = 0; i < d_; ++i) {
      VectorXd row = VectorXd::Zero(size_);
      for (Index k = 0; k < d_; ++k) {
        for (Index j = 0; j < d_; ++j) {
          row(C(k, j)) -= hessian(i, k) * z(j);
        }
        row(c(k)) -= hessian(i, k);
        row(R(i, k)) += sample.gradient(k);
      }
      for (std::size_t k = 0; k < linear_.size(); ++k) {
        row(beta(k)) = K.row(i).dot(linear_[k] * z);
      }
      for (Index k = 0; k < affine_.cols(); ++k) {
        row(gamma(k)) = K.row(i).dot(affine_.col(k));
      }
      add(std::move(row), 0.0);
    }
  }

  const MultisymplecticSystem& system_;
  int direction_;
  Index d_;
  std::vector<MatrixXd> linear_;
  MatrixXd affine_;
  Index size_;
  std::vector<VectorXd> rows_;
  std::vector<double> right_;
};

}  // namespace

std::optional<GalileiTransformation> galilei_transformation(const MultisymplecticSystem& system, int direction) {
  const auto& varying = system.coordinates();
  if (std::ranges::find(varying, direction) != varying.end()) {
    return std::nullopt;  // S names the direction
  }
  return GalileiEquations(system, direction).solve();
}

}  // namespace rubato
