#pragma once

#include <memory>
#include <vector>

#include "peer.hpp"

namespace peers {

/// The box scheme for u_tt = u_xx - sin u with equal steps, by PETSc's SNES: Newton's method with a Jacobian by hand,
/// in a matrix whose entries are written where they are, and KLU for its equations.
///
/// Of the three fields two are solved for, u and w = u_x in the middle of a step, as v = u_t follows from u node by
/// node. With A_x the mean and D_x the difference of neighbours:
///
///     D_x w - A_x (4(u - u_0)/h² - 2 v_0/h) = sin(A_x u),      D_x u = A_x w
///
/// A step begins at what those before extrapolate to, by a cubic, and ends where rounding does.
class SnesBox {
public:
  SnesBox(const Line& line, const Function& u, const Function& u_t, double h);
  SnesBox(const SnesBox&) = delete;
  SnesBox& operator=(const SnesBox&) = delete;
  ~SnesBox();

  /// \return whether SNES converged
  [[nodiscard]] bool step();
  [[nodiscard]] const std::vector<double>& u() const;
  [[nodiscard]] int iterations() const;  ///< of Newton's method, of all steps

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace peers
