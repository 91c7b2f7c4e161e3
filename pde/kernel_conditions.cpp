#include <rubato/pde/kernel_conditions.hpp>

#include <random>

#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd common_null_space(const MultisymplecticSystem& system, double theta, const MatrixXd& rows,
                           const MatrixXd& columns) {
  constexpr Index samples = 4;  // one would do, were the coefficients of S random as well
  std::mt19937_64 random(30);
  MatrixXd stacked(samples * rows.cols(), columns.cols());
  for (Index s = 0; s < samples; ++s) {
    const MatrixXd hessian = generic_hessian(system, random);
    stacked.middleRows(s * rows.cols(), rows.cols()) =
        solve::product(solve::product(rows.transpose(), theta * system.M() - hessian), columns);
  }
  return null_space(stacked);
}

KernelWaves::KernelWaves(const MatrixXd& M, const MatrixXd& kernel)
    : kernel_(kernel.cast<std::complex<double>>()),
      sizes_(kernel.cwiseAbs()),
      off_range_(null_space(MatrixXd((M * kernel).transpose())).cast<std::complex<double>>()) {}

bool KernelWaves::has(const Eigen::MatrixXcd& D) const {
  return kernel_.cols() > 0 && (off_range_.adjoint() * (D * kernel_)).cwiseAbs().maxCoeff() <=
                                   tuning::kernel_conditions::off_range * (D.cwiseAbs() * sizes_).maxCoeff();
}

std::vector<int> independent_rows(const Eigen::MatrixXcd& basis, const std::vector<int>& preferred) {
  std::vector<int> chosen;
  Eigen::MatrixXcd rows(0, basis.cols());
  for (const int candidate : preferred) {
    Eigen::MatrixXcd extended(rows.rows() + 1, basis.cols());
    extended.topRows(rows.rows()) = rows;
    extended.bottomRows(1) = basis.row(candidate);
    if (rank(extended.adjoint()) == extended.rows()) {
      rows = extended;
      chosen.push_back(candidate);
    }
  }
  return chosen;
}

namespace {

/// The means of fields that hold vectors of this kernel, of potentials first.
MatrixXd pins_of(const MultisymplecticSystem& system, const MatrixXd& kernel) {
  MatrixXd pins = MatrixXd::Zero(kernel.cols(), kernel.rows());
  if (kernel.cols() == 0) {
    return pins;
  }
  const FieldStructure& structure = system.structure();
  std::vector<int> order;
  for (const bool potentials : {true, false}) {
    for (int f = 0; f < system.field_count(); ++f) {
      if ((structure.potential[static_cast<std::size_t>(f)] && !structure.at_midpoints(f)) == potentials) {
        order.push_back(f);
      }
    }
  }
  const auto pinned = independent_rows(kernel.cast<std::complex<double>>(), order);
  for (std::size_t b = 0; b < pinned.size(); ++b) {
    pins(static_cast<Index>(b), pinned[b]) = 1.0;
  }
  return pins;
}

/// The dimension of the kernel of θM - S'' at a random z.
Index generic_nullity(const MultisymplecticSystem& system, double theta) {
  std::mt19937_64 random(30);
  return null_space(MatrixXd(theta * system.M() - generic_hessian(system, random))).cols();
}

}  // namespace

KernelConditions step_conditions(const MultisymplecticSystem& system, double h) {
  const Index d = system.field_count();
  const MatrixXd identity = MatrixXd::Identity(d, d);
  const double theta = 2.0 / h;
  KernelConditions conditions;
  conditions.kernel = common_null_space(system, theta, identity, identity);
  conditions.columns = common_null_space(system, -theta, identity, identity);  // (θM - S'')ᵀ = -θM - S''
  conditions.left = conditions.columns;
  conditions.pins = pins_of(system, conditions.kernel);
  return conditions;
}

KernelConditions wave_conditions(const MultisymplecticSystem& system, const MatrixXd& L, double h) {
  const double theta = 2.0 / h;
  KernelConditions conditions = step_conditions(system, h);
  const MatrixXd kernel = null_space(MatrixXd(theta * system.M() - L));
  if (kernel.cols() == conditions.count() || kernel.cols() != generic_nullity(system, theta)) {
    return conditions;
  }
  conditions.kernel = kernel;
  conditions.columns = null_space(MatrixXd(-theta * system.M() - L));
  conditions.left = conditions.columns;
  conditions.pins = pins_of(system, kernel);
  return conditions;
}

}  // namespace rubato
