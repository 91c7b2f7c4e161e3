#pragma once

#include <functional>
#include <string>
#include <vector>

#include <rubato/formula/expression.hpp>
#include <rubato/problem/document.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

struct RateNames {
  const std::vector<std::string>& form;    ///< fields of the form
  const std::vector<std::string>& fields;  ///< those of the density
  const std::vector<std::string>& axes;
};
using BuildFormula = std::function<formula::Expression(const FormulaText&)>;

/// Adds u_xt, u_yt, … to [initial] where they are fields of the form: derivatives of the u_t that it gives. \throws
/// ProblemError where one is given that is something else
void follow_rates(Value::Table& table, const RateNames& names, formula::Graph& graph, const BuildFormula& build);

}  // namespace rubato
