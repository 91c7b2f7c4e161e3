#pragma once

#include <array>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/pde/multisymplectic_form.hpp>
#include <rubato/problem/complex_parts.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

/// The i-th of so many complex unknowns: psi, or psi1, psi2, …
[[nodiscard]] std::string complex_name(std::size_t i, std::size_t count);

/// The names in a text.
[[nodiscard]] std::set<std::string> names_in(std::string_view text);

/// Formulas of fields, their derivatives, and complex unknowns, in [field].
class JetFormulas {
public:
  explicit JetFormulas(Section& root);

  FieldDensity density;  ///< its fields and the derivatives that were named
  std::vector<std::string> axes;
  std::vector<std::array<std::size_t, 2>> psi;  ///< the two fields of each complex unknown
  Parameters parameters;
  Names taken;

  /// Makes variables of the derivatives that a text names, itself or through definitions.
  void name_derivatives(const std::string& text, bool of_equation = false);
  /// A formula of what has been named.
  [[nodiscard]] formula::Expression build(const FormulaText& text);
  /// A side of an equation: also derivatives of what is in parentheses, (u^2)_xx, by the chain rule; |u|^2; and of
  /// complex unknowns conj, abs and abs2.
  [[nodiscard]] Complex side(const FormulaText& text);

  [[nodiscard]] formula::Expression field(std::size_t f) { return density.graph->variable(density.fields[f]); }
  /// Its derivative, of that order.
  [[nodiscard]] formula::Expression derivative(std::size_t f, const DerivativeOrder& order);

private:
  [[nodiscard]] Complex value_of(const struct EquationPart& part, const std::string& text, const Location& place);
  [[nodiscard]] std::string name_of_part(std::string text) const;
  [[nodiscard]] formula::Expression differentiated(formula::Expression e, std::size_t mu);

  Section& root_;
  std::set<std::string> names_;                           ///< of derivatives
  std::map<std::string, NamedDerivative> complex_names_;  ///< psi and its derivatives
  std::map<formula::NodeIndex, Complex> parts_;           ///< what names that stand for a part of a text are
  std::vector<std::string> part_names_;
  bool has_definitions_ = false;
};

}  // namespace rubato
