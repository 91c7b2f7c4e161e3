#pragma once

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rubato/grids/field_set.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// The row of a field that alone occurs in it: ∂S/∂s = a s + b.
struct LinearRow {
  double a = 0.0, b = 0.0;
};
/// True if the row of a field has no derivative in space.
[[nodiscard]] bool in_no_K(const MultisymplecticSystem& system, int field);
/// That of a field, with a ≠ 0 and a, b the same everywhere; nothing where it is another.
[[nodiscard]] std::optional<LinearRow> linear_row(const MultisymplecticSystem& system, int field);

/// Fields that their own row gives node by node, so that the linear systems of a step need not hold them: v of a wave
/// equation, whose row reads v̄ = δu/h.
///
/// Such a field s occurs in no K_a, and ∂S/∂s = a s + b with constants a ≠ 0 and b. Its row of the midpoint rule is
/// A (Σ_j M_sj δ_j/h - a m_s - b) = 0 with m the middle of the step, and A has no kernel on the grids of a scheme:
///
///     m_s = (Σ_j M_sj δ_j/h - b)/a,    c_s = (2/h) Σ_j M_sj c_j / a  for a correction c of m.
class StaticCondensation {
public:
  explicit StaticCondensation(const MultisymplecticSystem& system);
  /// None: every field is free.
  StaticCondensation(const MultisymplecticSystem& system, std::nullptr_t);

  [[nodiscard]] const std::vector<int>& free() const { return free_; }

  /// (2/h) M - (S'')_constant for the free fields, the condensed ones eliminated.
  void reduced_mean(double h, Eigen::MatrixXd& reduced) const;
  /// The entries of a matrix for the free fields.
  [[nodiscard]] Eigen::MatrixXd restricted(const Eigen::MatrixXd& matrix) const;
  /// The number of a field among the free ones.
  [[nodiscard]] int place(int field) const;

  /// Sets the condensed fields' δ = 2 (m - z) by the others', z = high + low.
  void follow(double h, const grids::FieldSet& high, const grids::FieldSet& low, grids::FieldSet& delta) const;
  /// Sets the condensed fields' corrections by the others'.
  void correct(double h, grids::FieldSet& correction) const;

private:
  struct Slave {
    int field = 0;
    LinearRow row;
    std::vector<std::pair<int, double>> masters;  ///< j and M_sj
  };
  MultisymplecticSystem system_;
  std::vector<int> free_;
  std::vector<Slave> slaves_;
};

}  // namespace rubato
