#include "gauss_coefficients.hpp"

#include <rubato/variation/gauss_tableau.hpp>

namespace peers {

GaussCoefficients::GaussCoefficients(int stages) {
  const rubato::GaussTableau tableau(stages);
  const Eigen::VectorXd w = tableau.inverse().end;
  for (int i = 0; i < stages; ++i) {
    end.push_back(w[i]);
    for (int j = 0; j < stages; ++j) {
      a.push_back(tableau.a(i, j));
      ahead.push_back(tableau.lagrange(j, 1.0 + tableau.c[i]));
    }
  }
}

}  // namespace peers
