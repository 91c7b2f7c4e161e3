#include "gauss.hpp"

#include <rubato/variation/gauss_tableau.hpp>

namespace orbits {

GaussCoefficients gauss_coefficients(int stages) {
  const rubato::GaussTableau tableau(stages);
  GaussCoefficients result;
  for (int i = 0; i < stages; ++i) {
    for (int j = 0; j < stages; ++j) {
      result.a.push_back(tableau.a(i, j));
      result.ahead.push_back(tableau.lagrange(j, 1.0 + tableau.c[i]));
    }
    result.b.push_back(tableau.b[i]);
    result.c.push_back(tableau.c[i]);
  }
  return result;
}

}  // namespace orbits
