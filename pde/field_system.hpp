#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/pde/multisymplectic_form.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

/// \file
/// Field equations stated as on paper, by a Lagrangian density or by the equations themselves; M, K and S are derived
/// (multisymplectic_form(), density_of()). [field] of a problem file is the same.
namespace rubato {

/// The fields of a density and their derivatives, by name: j("u"), j("u_t"), j("u_xx").
class FieldJets {
public:
  /// \throws std::invalid_argument unless there are 1 to 3 directions of space
  FieldJets(std::vector<std::string> fields, int dimensions);

  /// \throws std::invalid_argument if it is neither a field nor a derivative of one, by t and the directions of space
  [[nodiscard]] formula::Expression operator()(std::string_view name);
  /// The same; nothing if it is neither.
  [[nodiscard]] std::optional<formula::Expression> find(std::string_view name);
  /// x, y, z or t.
  [[nodiscard]] formula::Expression coordinate(std::string_view name);

  [[nodiscard]] const std::vector<std::string>& fields() const { return density_.fields; }
  [[nodiscard]] int dimensions() const { return density_.dimensions; }
  [[nodiscard]] const std::shared_ptr<formula::Graph>& graph() const { return density_.graph; }
  [[nodiscard]] const std::vector<FieldDensity::Derivative>& derivatives() const { return density_.derivatives; }

private:
  FieldDensity density_;
};

/// The system whose equations are the Euler–Lagrange equations of L, a formula or a lambda of the jets:
///
///     field_system({"u"}, "u_t^2/2 - u_x^2/2 - (1 - cos(u))")
///     field_system({"u"}, [](FieldJets& j) { return 0.5 * pow(j("u_t"), 2) - 0.5 * pow(j("u_x"), 2) - … ; })
///
/// Its fields are those of L, then u_t, u_x and others that the form needs. L may name x, y, z, not t.
/// \throws formula::ParseError; std::invalid_argument as multisymplectic_form() and MultisymplecticSystem
///@{
[[nodiscard]] MultisymplecticSystem field_system(std::vector<std::string> fields, std::string_view L,
                                                 const MultisymplecticSystem::Parameters& parameters = {},
                                                 int dimensions = 1);
[[nodiscard]] MultisymplecticSystem field_system(std::vector<std::string> fields,
                                                 const std::function<formula::Expression(FieldJets&)>& L,
                                                 int dimensions = 1);
///@}

/// Where the one sign = of an equation stands. \throws std::invalid_argument unless there is one
[[nodiscard]] std::size_t sign_of_equation(std::string_view text);

/// The same as field_system() of equations, "u_tt = u_xx - sin(u)", one for each field, whose density is looked for.
/// \throws formula::ParseError; std::invalid_argument as density_of() and sign_of_equation()
[[nodiscard]] MultisymplecticSystem equation_system(std::vector<std::string> fields,
                                                    const std::vector<std::string>& equations,
                                                    const MultisymplecticSystem::Parameters& parameters = {},
                                                    int dimensions = 1);

}  // namespace rubato
