#pragma once

#include <vector>

namespace peers {

/// Of Gauss collocation, in arrays: codes by hand are compiled for other vectors than the library, and share no Eigen
/// with it. Matrices go row by row.
struct GaussCoefficients {
  explicit GaussCoefficients(int stages);

  std::vector<double> a;
  std::vector<double> ahead;  ///< stages of the next step from those of the last, by their polynomial
  std::vector<double> end;    ///< w of z_1 = z_0 + Σ w_i (Z_i - z_0)
};

}  // namespace peers
