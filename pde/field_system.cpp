#include <rubato/pde/field_system.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/formula/parse.hpp>
#include <rubato/pde/inverse_problem.hpp>

namespace rubato {

namespace {

MultisymplecticSystem system_of(const FieldDensity& density) {
  const MultisymplecticForm form = multisymplectic_form(density);
  const auto d = static_cast<Eigen::Index>(form.fields.size());
  const auto matrix = [&](std::size_t mu) {
    Eigen::MatrixXd entries = Eigen::MatrixXd::Zero(d, d);
    for (const auto& [row, column, value] : form.terms.at(mu)) {
      const auto i = static_cast<Eigen::Index>(row), j = static_cast<Eigen::Index>(column);
      entries(i, j) = value;
      entries(j, i) = -value;
    }
    return entries;
  };
  std::vector<Eigen::MatrixXd> K;
  for (int a = 0; a < density.dimensions; ++a) {
    K.push_back(matrix(static_cast<std::size_t>(a) + 1));
  }
  return {density.graph, form.fields, matrix(0), std::move(K), form.S};
}

FieldDensity density_with(const FieldJets& jets, formula::Expression L) {
  FieldDensity density;
  density.graph = jets.graph();
  density.fields = jets.fields();
  density.derivatives = jets.derivatives();
  density.dimensions = jets.dimensions();
  density.L = L;
  return density;
}

formula::Expression parse(std::string_view text, FieldJets& jets, const MultisymplecticSystem::Parameters& parameters) {
  const auto resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
    if (const auto parameter = parameters.find(std::string(name)); parameter != parameters.end()) {
      return jets.graph()->constant(parameter->second);
    }
    if (const auto jet = jets.find(name)) {
      return jet;
    }
    const bool is_coordinate =
        name.size() == 1 && std::string_view("xyz").substr(0, static_cast<std::size_t>(jets.dimensions())).find(name) !=
                                std::string_view::npos;
    return is_coordinate ? std::optional(jets.coordinate(name)) : std::nullopt;
  };
  return formula::parse(text, *jets.graph(), {.resolve = resolve, .known_names = jets.fields()});
}

}  // namespace

FieldJets::FieldJets(std::vector<std::string> fields, int dimensions) {
  if (dimensions < 1 || dimensions > 3) {
    throw std::invalid_argument(fmt::format("{} directions of space: there are 1 to 3", dimensions));
  }
  density_.graph = std::make_shared<formula::Graph>();
  density_.fields = std::move(fields);
  density_.dimensions = dimensions;
}

std::optional<formula::Expression> FieldJets::find(std::string_view name) {
  const auto is_field = std::ranges::find(density_.fields, name) != density_.fields.end();
  const auto derivative = is_field ? std::nullopt : derivative_named(name, density_.fields);
  if (!is_field && !derivative) {
    return std::nullopt;
  }
  const formula::Expression variable = density_.graph->variable(name);
  if (derivative && std::ranges::find(density_.derivatives, variable, &FieldDensity::Derivative::variable) ==
                        density_.derivatives.end()) {
    density_.derivatives.push_back({derivative->field, derivative->order, variable});
  }
  return variable;
}

formula::Expression FieldJets::operator()(std::string_view name) {
  if (const auto found = find(name)) {
    return *found;
  }
  throw std::invalid_argument(fmt::format("{} is neither a field nor a derivative of one, such as {}_xt", name,
                                          density_.fields.empty() ? "u" : density_.fields.front()));
}

formula::Expression FieldJets::coordinate(std::string_view name) {
  return density_.graph->variable(name);
}

MultisymplecticSystem field_system(std::vector<std::string> fields, std::string_view L,
                                   const MultisymplecticSystem::Parameters& parameters, int dimensions) {
  FieldJets jets(std::move(fields), dimensions);
  const formula::Expression density = parse(L, jets, parameters);
  return system_of(density_with(jets, density));
}

MultisymplecticSystem field_system(std::vector<std::string> fields,
                                   const std::function<formula::Expression(FieldJets&)>& L, int dimensions) {
  FieldJets jets(std::move(fields), dimensions);
  const formula::Expression density = L(jets);
  return system_of(density_with(jets, density));
}

std::size_t sign_of_equation(std::string_view text) {
  const std::size_t sign = text.find('=');
  if (sign == std::string_view::npos || text.find('=', sign + 1) != std::string_view::npos) {
    throw std::invalid_argument(fmt::format("\"{}\" is no equation: write left side = right side", text));
  }
  return sign;
}

MultisymplecticSystem equation_system(std::vector<std::string> fields, const std::vector<std::string>& equations,
                                      const MultisymplecticSystem::Parameters& parameters, int dimensions) {
  FieldJets jets(std::move(fields), dimensions);
  FieldEquations stated{jets.graph(), jets.fields(), {}, dimensions, {}};
  for (const std::string& text : equations) {
    const std::size_t sign = sign_of_equation(text);
    const formula::Expression left = parse(std::string_view(text).substr(0, sign), jets, parameters);
    stated.equations.push_back(left - parse(std::string_view(text).substr(sign + 1), jets, parameters));
  }
  stated.derivatives = jets.derivatives();
  return system_of(density_of(stated));
}

}  // namespace rubato
