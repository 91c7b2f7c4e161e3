#pragma once

#include <span>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// Indices of the nodes on which `roots` (of one graph) depend, the roots included, ascending: a topological order.
/// \throws std::invalid_argument if a root is empty or of another graph than the first
[[nodiscard]] std::vector<NodeIndex> reachable(std::span<const Expression> roots);

}  // namespace rubato::formula
