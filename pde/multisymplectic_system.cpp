#include <rubato/pde/multisymplectic_system.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/branches.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato {

namespace {

constexpr std::string_view coordinate_names = "xyz";

/// Whether one of the names occurs: sign(x) depends on x, though its derivative is 0.
bool depends_on(const formula::Graph& graph, formula::Expression expression, std::span<const std::string> names) {
  const auto used = formula::variables_of(expression);
  return std::ranges::any_of(used, [&](std::size_t variable) {
    return std::ranges::find(names, graph.variable_name(variable)) != names.end();
  });
}

void check_skew(const Eigen::MatrixXd& matrix, const std::string& what, const std::vector<std::string>& fields) {
  const auto d = static_cast<Eigen::Index>(fields.size());
  if (matrix.rows() != d || matrix.cols() != d) {
    throw std::invalid_argument(
        fmt::format("{} is {} by {}, but there are {} fields", what, matrix.rows(), matrix.cols(), d));
  }
  for (Eigen::Index i = 0; i < d; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      if (!(matrix(i, j) == -matrix(j, i)) || !std::isfinite(matrix(i, j))) {
        throw std::invalid_argument(fmt::format("{} is not skew-symmetric: [{}, {}] is {} and [{}, {}] is {}", what,
                                                fields[j], fields[i], matrix(j, i), fields[i], fields[j],
                                                matrix(i, j)));
      }
    }
  }
}

}  // namespace

MultisymplecticSystem::Traced MultisymplecticSystem::parse(std::vector<std::string> fields, std::string_view S,
                                                           const Parameters& parameters) {
  auto graph = std::make_shared<formula::Graph>();
  std::vector<std::string> known = fields;
  for (const std::string& name : fields) {
    if (!formula::is_valid_name(name)) {
      throw std::invalid_argument(fmt::format("\"{}\" cannot name a field", name));
    }
    graph->variable(name);
  }
  for (const auto& [name, value] : parameters) {
    if (std::ranges::find(fields, name) != fields.end()) {
      throw std::invalid_argument(fmt::format("\"{}\" names both a field and a parameter", name));
    }
    known.push_back(name);
  }
  const auto resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
    if (std::ranges::find(fields, name) != fields.end()) {
      return graph->variable(name);
    }
    if (const auto parameter = parameters.find(std::string(name)); parameter != parameters.end()) {
      return graph->constant(parameter->second);
    }
    const bool is_axis = name.size() == 1 && coordinate_names.find(name) != std::string_view::npos;
    return is_axis ? std::optional(graph->variable(name)) : std::nullopt;
  };
  const formula::Expression expression = formula::parse(S, *graph, {.resolve = resolve, .known_names = known});
  return {graph, std::move(fields), expression};
}

MultisymplecticSystem::MultisymplecticSystem(std::vector<std::string> fields, Eigen::MatrixXd M,
                                             std::vector<Eigen::MatrixXd> K, std::string_view S,
                                             const Parameters& parameters)
    : MultisymplecticSystem(parse(std::move(fields), S, parameters), std::move(M), std::move(K)) {}

MultisymplecticSystem::MultisymplecticSystem(std::shared_ptr<formula::Graph> graph, std::vector<std::string> fields,
                                             Eigen::MatrixXd M, std::vector<Eigen::MatrixXd> K, formula::Expression S)
    : MultisymplecticSystem(Traced{std::move(graph), std::move(fields), S}, std::move(M), std::move(K)) {}

MultisymplecticSystem::MultisymplecticSystem(std::shared_ptr<formula::Graph> graph, std::vector<std::string> fields,
                                             Eigen::MatrixXd M, std::vector<Eigen::MatrixXd> K, formula::Expression S,
                                             Ramps ramps)
    : MultisymplecticSystem(Traced{std::move(graph), std::move(fields), S}, std::move(M), std::move(K),
                            std::move(ramps)) {}

MultisymplecticSystem::MultisymplecticSystem(Traced traced, Eigen::MatrixXd M, std::vector<Eigen::MatrixXd> K,
                                             Ramps ramps)
    : graph_(std::move(traced.graph)),
      fields_(std::move(traced.fields)),
      M_(std::move(M)),
      K_(std::move(K)),
      S_(traced.S),
      ramps_(std::move(ramps)) {
  check();
  compile();
  structure_ = std::make_shared<const FieldStructure>(analyse(*this));
}

int MultisymplecticSystem::field(std::string_view name) const {
  const auto found = std::ranges::find(fields_, name);
  if (found == fields_.end()) {
    throw std::invalid_argument(
        fmt::format("there is no field \"{}\"; the fields are {}", name, fmt::join(fields_, ", ")));
  }
  return static_cast<int>(found - fields_.begin());
}

bool MultisymplecticSystem::has_source(int axis) const {
  const auto at = std::ranges::find(coordinates_, axis);
  if (at == coordinates_.end() || ramps_.slopes.empty()) {
    return at != coordinates_.end();
  }
  const formula::Expression source = ramps_.sources[static_cast<std::size_t>(axis)];
  return !source.is_constant() || source.constant_value() != 0.0;
}

void MultisymplecticSystem::check() const {
  if (fields_.empty() || fields_.size() > static_cast<std::size_t>(most_fields)) {
    throw std::invalid_argument(
        fmt::format("a multisymplectic system has 1 to {} fields; got {}", most_fields, fields_.size()));
  }
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    if (std::ranges::count(fields_, fields_[i]) > 1) {
      throw std::invalid_argument(fmt::format("the field \"{}\" is named twice", fields_[i]));
    }
  }
  if (K_.empty() || K_.size() > 3) {
    throw std::invalid_argument(fmt::format("there must be one K for each of 1 to 3 directions; got {}", K_.size()));
  }
  check_skew(M_, "M", fields_);
  for (std::size_t a = 0; a < K_.size(); ++a) {
    check_skew(K_[a], fmt::format("K.{}", coordinate_names[a]), fields_);
  }
}

void MultisymplecticSystem::find_coordinates() {
  for (const std::string& name : fields_) {
    variables_.push_back(graph_->variable(name));
  }
  for (const std::size_t variable : formula::variables_of(S_)) {
    const std::string& name = graph_->variable_name(variable);
    if (std::ranges::find(fields_, name) != fields_.end()) {
      continue;
    }
    const std::size_t axis = name.size() == 1 ? coordinate_names.find(name) : std::string_view::npos;
    if (axis >= K_.size()) {
      throw std::invalid_argument(fmt::format(
          "S names {}, which is neither a field nor a coordinate of the {} direction(s) of space", name, K_.size()));
    }
    coordinates_.push_back(static_cast<int>(axis));
  }
  std::ranges::sort(coordinates_);
  for (const int axis : coordinates_) {
    variables_.push_back(graph_->variable(coordinate_names.substr(static_cast<std::size_t>(axis), 1)));
  }
}

void MultisymplecticSystem::compile() {
  find_coordinates();
  const std::span<const formula::Expression> z(variables_.data(), fields_.size());
  const std::span<const formula::Expression> x = std::span<const formula::Expression>(variables_).subspan(z.size());
  const formula::WithoutConstant separated = formula::separate_constant(S_);
  if (separated.constant != 0.0) {
    constant_ = separated.constant;
    reduced_ = std::make_shared<const MultisymplecticSystem>(graph_, fields_, M_, K_, separated.rest, ramps_);
  }
  size_ = std::make_shared<const formula::Bytecode>(formula::sum_size_code(S_, variables_));
  std::vector<std::string> names_of_coordinates;
  for (const int axis : coordinates_) {
    names_of_coordinates.emplace_back(1, coordinate_names[static_cast<std::size_t>(axis)]);
  }
  std::vector<formula::Expression> outputs = {S_};
  value_ = std::make_shared<const formula::Bytecode>(outputs, variables_);
  std::ranges::copy(formula::gradient(S_, z), std::back_inserter(outputs));
  for (std::size_t f = 0; f < fields_.size(); ++f) {
    varies_in_space_.push_back(depends_on(*graph_, outputs[1 + f], names_of_coordinates));
  }
  gradient_ = std::make_shared<const formula::Bytecode>(outputs, variables_);
  if (ramps_.slopes.empty()) {
    sources_ = formula::gradient(S_, x);
  } else {
    std::ranges::transform(coordinates_, std::back_inserter(sources_),
                           [&](int axis) { return ramps_.sources[static_cast<std::size_t>(axis)]; });
  }
  source_ = std::make_shared<const formula::Bytecode>(sources_, variables_);
  const auto upper = formula::hessian_upper(S_, z);
  const bool has_pieces = formula::is_piecewise(S_, z);
  // |u| has a slope that changes where u = 0, and a second derivative that is 0 on either side.
  const auto changes_slope = [&](int i, int j) {
    return formula::is_piecewise(outputs[static_cast<std::size_t>(1 + i)], z.subspan(static_cast<std::size_t>(j), 1));
  };
  const int d = field_count();
  constant_hessian_ = Eigen::MatrixXd::Zero(d, d);
  std::size_t next = 0;
  for (int i = 0; i < d; ++i) {
    for (int j = i; j < d; ++j) {
      const formula::Expression entry = upper[next++];
      const bool is_in_pieces = has_pieces && (changes_slope(i, j) || changes_slope(j, i));
      if (entry.is_constant() && !is_in_pieces) {
        constant_hessian_(i, j) = constant_hessian_(j, i) = entry.constant_value();
      } else {
        varying_.push_back({i, j});
        if (is_in_pieces || depends_on(*graph_, entry, fields_)) {
          nonlinear_.push_back({i, j});
        }
        outputs.push_back(entry);
      }
    }
  }
  hessian_ = std::make_shared<const formula::Bytecode>(outputs, variables_);
}

Eigen::MatrixXd MultisymplecticSystem::hessian(std::span<const double> point) const {
  formula::ScalarEvaluator evaluate(*hessian_);
  std::vector<double> outputs(hessian_->output_count());
  evaluate(point, outputs);
  Eigen::MatrixXd result = constant_hessian_;
  for (std::size_t e = 0; e < varying_.size(); ++e) {
    const auto [row, column] = varying_[e];
    result(row, column) = result(column, row) = outputs[1 + fields_.size() + e];
  }
  return result;
}

MultisymplecticSystem MultisymplecticSystem::at_levels() const {
  MultisymplecticSystem result(*this);
  auto structure = std::make_shared<FieldStructure>(*structure_);
  structure->nonlinear.assign(structure->nonlinear.size(), false);
  result.structure_ = std::move(structure);
  if (reduced_) {
    result.reduced_ = std::make_shared<const MultisymplecticSystem>(reduced_->at_levels());
  }
  return result;
}

}  // namespace rubato
