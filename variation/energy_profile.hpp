#pragma once

#include <array>
#include <cstddef>
#include <span>

#include <rubato/variation/level_scheme.hpp>

namespace rubato {

/// E_k as a function of the length of a step, near one: the polynomial of degree seven through its values at the zeros
/// of Chebyshev's polynomial of degree eight. With x from -1 to 1 over a part w of the length on either side the rest
/// is a_8 w⁸/2⁷, a_8 the eighth coefficient of E_k's own series (L. N. Trefethen, Approximation Theory and
/// Approximation Practice, chapter 6), and rounding of the values is not multiplied by more than 2.3 (its chapter 15);
/// beyond -1 and 1 both grow quickly.
class EnergyProfile {
public:
  static constexpr std::size_t count = LevelScheme::abreast;
  /// Where values are asked for.
  static constexpr std::array<double, count> places{
      0.98078528040323044913,  0.83146961230254523708,  0.55557023301960222474,  0.19509032201612826785,
      -0.98078528040323044913, -0.83146961230254523708, -0.55557023301960222474, -0.19509032201612826785};

  explicit EnergyProfile(std::span<const double, count> values);

  struct Point {
    double value = 0.0, slope = 0.0, bend = 0.0;  ///< with the first two derivatives by x
  };
  [[nodiscard]] Point at(double x) const;
  [[nodiscard]] Point middle() const { return {.value = even_[0], .slope = odd_[0], .bend = 2.0 * even_[1]}; }

private:
  static constexpr std::size_t half = count / 2;
  std::array<double, half> even_{}, odd_{};  ///< Σ even x^(2k) + x Σ odd x^(2k)
};

inline EnergyProfile::Point EnergyProfile::at(double x) const {
  const double y = x * x;
  const auto& [e_0, e_1, e_2, e_3] = even_;
  const auto& [o_0, o_1, o_2, o_3] = odd_;
  return {.value = (e_0 + y * (e_1 + y * (e_2 + y * e_3))) + x * (o_0 + y * (o_1 + y * (o_2 + y * o_3))),
          .slope = x * (2.0 * e_1 + y * (4.0 * e_2 + y * (6.0 * e_3))) +
                   (o_0 + y * (3.0 * o_1 + y * (5.0 * o_2 + y * (7.0 * o_3)))),
          .bend = (2.0 * e_1 + y * (12.0 * e_2 + y * (30.0 * e_3))) +
                  x * (6.0 * o_1 + y * (20.0 * o_2 + y * (42.0 * o_3)))};
}

}  // namespace rubato
