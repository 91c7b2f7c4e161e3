#include <rubato/formula/reachable.hpp>

#include <algorithm>
#include <cstdint>
#include <stdexcept>

namespace rubato::formula {

std::vector<NodeIndex> reachable(std::span<const Expression> roots) {
  if (roots.empty()) {
    return {};
  }
  const Graph* graph = roots.front().graph();
  NodeIndex last = 0;
  for (const Expression root : roots) {
    if (!root.valid() || root.graph() != graph) {
      throw std::invalid_argument(root.valid() ? "expressions of different graphs cannot be used together"
                                               : "an empty expression has no value");
    }
    last = std::max(last, root.index());
  }
  std::vector<std::uint8_t> needed(std::size_t{last} + 1, 0);
  for (const Expression root : roots) {
    needed[root.index()] = 1;
  }
  // Arguments come before their users, so one sweep downward marks everything.
  std::vector<NodeIndex> order;
  for (std::size_t index = needed.size(); index-- > 0;) {
    if (needed[index] == 0) {
      continue;
    }
    order.push_back(static_cast<NodeIndex>(index));
    const Node& node = graph->node(static_cast<NodeIndex>(index));
    const int arguments = arity(node.operation);
    if (arguments >= 1) {
      needed[node.a] = 1;
    }
    if (arguments == 2) {
      needed[node.b] = 1;
    }
  }
  std::reverse(order.begin(), order.end());
  return order;
}

}  // namespace rubato::formula
