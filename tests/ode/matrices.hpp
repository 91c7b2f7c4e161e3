#pragma once

#include <random>

#include <Eigen/Core>

/// Entries between -1 and 1; the same for the same seed.
inline Eigen::MatrixXd random_symmetric(Eigen::Index size, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  Eigen::MatrixXd F(size, size);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      F(i, j) = F(j, i) = unit(random);
    }
  }
  return F;
}
