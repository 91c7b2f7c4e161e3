#include <rubato/variation/node_code.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <set>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/grids/parallel.hpp>
#include <rubato/variation/terms_by_middle.hpp>
#include <rubato/variation/weighted_terms.hpp>

namespace rubato {

namespace {

/// The place so much further on a line that closes.
std::size_t moved(std::size_t i, int by, std::size_t of) {
  auto j = static_cast<std::ptrdiff_t>(i) + by;
  const auto n = static_cast<std::ptrdiff_t>(of);
  for (; j < 0; j += n) {
  }
  for (; j >= n; j -= n) {
  }
  return static_cast<std::size_t>(j);
}

}  // namespace

NodeCode::NodeCode(std::span<const formula::Expression> outputs, std::span<const NodeInput> inputs,
                   const grids::Grid& grid, std::vector<PlaceNumbers> of_axes)
    : cells_{grid.cells(0), grid.cells(1), grid.cells(2)}, of_axes_(std::move(of_axes)), outputs_(outputs.size()) {
  std::set<std::size_t> read;
  for (const formula::Expression& output : outputs) {
    const auto numbers = formula::variables_of(output);
    read.insert(numbers.begin(), numbers.end());
  }
  std::vector<formula::Expression> variables;
  for (const NodeInput& input : inputs) {
    if (read.contains(formula::variables_of(input.variable).front())) {
      inputs_.push_back(input);
      variables.push_back(input.variable);
    }
  }
  prototype_ = formula::BatchEvaluator(formula::Bytecode(outputs, variables));
}

void NodeCode::read(std::span<const grids::FieldSet* const> arrays, std::span<const double> numbers,
                    const PotentialSlopes& slopes) {
  arrays_.clear();
  for (const grids::FieldSet* part : arrays) {
    arrays_.insert(arrays_.end(), part->pointers().begin(), part->pointers().end());
  }
  prepare(numbers, slopes);
}

void NodeCode::read(std::span<const double* const> arrays, std::span<const double> numbers,
                    const PotentialSlopes& slopes) {
  arrays_.assign(arrays.begin(), arrays.end());
  prepare(numbers, slopes);
}

void NodeCode::prepare(std::span<const double> numbers, const PotentialSlopes& slopes) {
  numbers_.assign(numbers.begin(), numbers.end());
  slopes_ = &slopes;
  while (workspaces_.size() < static_cast<std::size_t>(grids::thread_count())) {
    Workspace& work = workspaces_.emplace_back();
    work.code = prototype_;
    work.in.resize(inputs_.size());
    work.out.resize(outputs_);
    work.copies.resize(inputs_.size());  // all of them 0
  }
  for (Workspace& work : workspaces_) {
    for (std::size_t j = 0; j < inputs_.size(); ++j) {
      if (inputs_[j].kind == NodeInput::Kind::uniform) {
        work.fill(j, numbers_[static_cast<std::size_t>(inputs_[j].number)]);
      }
    }
  }
}

void NodeCode::Workspace::fill(std::size_t input, double value) {
  // They are the same from piece to piece, and mostly from level to level.
  if (std::bit_cast<std::uint64_t>(copies[input].front()) != std::bit_cast<std::uint64_t>(value)) {
    copies[input].fill(value);
  }
}

void NodeCode::operator()(std::size_t begin, std::size_t end, std::span<double* const> outputs) {
  grids::for_each_block(end - begin, grids::nodes_per_block,
                        [&](std::size_t first, std::size_t last, std::size_t thread) {
                          evaluate(thread, begin + first, begin + last, outputs);
                        });
}

void NodeCode::evaluate(std::size_t thread, std::size_t begin, std::size_t end, std::span<double* const> outputs,
                        std::span<double* const> from_begin) {
  const std::size_t line = cells_[0];
  Workspace& work = workspaces_[thread];
  for (std::size_t node = begin; node < end;) {
    const std::size_t place = node % line;
    const std::size_t count = std::min({piece, line - place, end - node});
    place_inputs(work, node / line, place, count);
    for (std::size_t j = 0; j < outputs.size(); ++j) {
      work.out[j] = outputs[j] + node;
    }
    for (std::size_t k = 0; k < from_begin.size(); ++k) {
      work.out[outputs.size() + k] = from_begin[k] + (node - begin);
    }
    work.code(count, work.in, work.out);
    node += count;
  }
}

std::optional<std::size_t> NodeCode::reach(std::span<const int> arrays) const {
  const std::size_t last = cells_[2] > 1 ? 2 : cells_[1] > 1 ? 1 : 0;
  const std::size_t stride = last == 2 ? cells_[0] * cells_[1] : last == 1 ? cells_[0] : 1;
  std::optional<std::size_t> found;
  for (const NodeInput& input : inputs_) {
    if (input.kind == NodeInput::Kind::node && std::ranges::find(arrays, input.number) != arrays.end()) {
      const bool crosses_seams = std::any_of(input.offset.begin(), input.offset.begin() + static_cast<int>(last),
                                             [](int by) { return by != 0; });
      const std::size_t far =
          (static_cast<std::size_t>(std::abs(input.offset[last])) + (crosses_seams ? 1 : 0)) * stride;
      found = std::max(found.value_or(0), far);
    }
  }
  return found;
}

void NodeCode::place_inputs(Workspace& work, std::size_t line, std::size_t begin, std::size_t count) const {
  const auto [n, rows, layers] = cells_;
  const std::size_t row = line % rows, layer = line / rows;
  for (std::size_t j = 0; j < inputs_.size(); ++j) {
    const NodeInput& input = inputs_[j];
    double* const copy = work.copies[j].data();
    work.in[j] = copy;
    const std::size_t other = moved(layer, input.offset[2], layers) * rows + moved(row, input.offset[1], rows);
    if (input.kind == NodeInput::Kind::slope) {
      work.fill(j, slopes_->at(input.number, other));
      continue;
    }
    const double* start = nullptr;
    if (input.kind == NodeInput::Kind::node) {
      start = arrays_[static_cast<std::size_t>(input.number)] + other * n;
    } else if (input.kind == NodeInput::Kind::axis) {
      const PlaceNumbers& numbers = of_axes_[static_cast<std::size_t>(input.number)];
      if (numbers.axis == 0) {
        start = numbers.values.data();
      } else {
        work.fill(j, numbers.values[numbers.axis == 1 ? other % rows : other / rows]);
      }
    }
    if (start != nullptr) {
      const auto from = static_cast<std::ptrdiff_t>(begin) + input.offset[0];
      const auto to = from + static_cast<std::ptrdiff_t>(count);
      if (from >= 0 && to <= static_cast<std::ptrdiff_t>(n)) {
        work.in[j] = start + from;
        continue;
      }
      for (std::size_t done = 0; done < count;) {  // in pieces between seams
        const std::size_t place = moved(begin + done, input.offset[0], n);
        const std::size_t some = std::min(count - done, n - place);
        std::copy_n(start + place, some, copy + done);
        done += some;
      }
    }
  }
}

formula::Expression NodeFormulas::variable(NodeInput input) {
  const std::size_t known = graph_->variable_count();
  input.variable = graph_->variable(fmt::format("{} {} {} {} {}", static_cast<int>(input.kind), input.number,
                                                input.offset[0], input.offset[1], input.offset[2]));
  if (graph_->variable_count() > known) {
    inputs_.push_back(input);
  }
  return input.variable;
}

NodeFormulas::Weights NodeFormulas::weights(const grids::SpaceOperator& op) const {
  if (op.spectral_axis >= 0) {
    throw std::invalid_argument("a spectral derivative reads all nodes, not the neighbours of one");
  }
  Weights all = {{{}, op.mirrored ? -1.0 : 1.0}};
  for (std::size_t a = 0; a < op.box.size(); ++a) {
    const grids::Along along = op.box[a];
    if (along == grids::Along::identity) {
      continue;
    }
    const double scale = along == grids::Along::average      ? 0.5
                         : along == grids::Along::difference ? 1.0 / grid_.spacing(static_cast<int>(a))
                                                             : 1.0;
    Weights next;
    for (const auto& [offset, weight] : all) {
      auto further = offset;
      further[a] += op.mirrored ? -1 : 1;
      next.emplace_back(further, scale * weight);
      if (along != grids::Along::next) {
        next.emplace_back(offset, (along == grids::Along::difference ? -scale : scale) * weight);
      }
    }
    all = std::move(next);
  }
  return all;
}

formula::Expression NodeFormulas::in_cell(const grids::SpaceOperator& op, int array, std::array<int, 3> cell) {
  Weights all = weights(op);
  // One order of the nodes for all cells: what two have in common is the same formula.
  std::ranges::sort(all, [](const auto& a, const auto& b) { return a.first > b.first; });
  const double scale = std::abs(all.front().second);
  formula::Expression total;
  for (auto [offset, weight] : all) {
    std::ranges::transform(offset, cell, offset.begin(), std::plus());
    add_weighted(total, weight / scale, node(array, offset));
  }
  return scale == 1.0 ? total : scale * total;
}

formula::Expression NodeFormulas::along_axis(const PlaceNumbers& numbers, int offset) {
  const auto known = std::ranges::find(of_axes_, numbers);
  const auto number = static_cast<int>(known - of_axes_.begin());
  if (known == of_axes_.end()) {
    of_axes_.push_back(numbers);
  }
  std::array<int, 3> place{};
  place.at(static_cast<std::size_t>(numbers.axis)) = offset;
  return variable({{}, NodeInput::Kind::axis, number, place});
}

formula::Expression NodeFormulas::at(const NodeInput& input, const std::array<int, 3>& offset) {
  switch (input.kind) {
    case NodeInput::Kind::node: return node(input.number, offset);
    case NodeInput::Kind::slope: return slope(input.number, offset);
    case NodeInput::Kind::axis: {
      const PlaceNumbers numbers = of_axes_[static_cast<std::size_t>(input.number)];
      return along_axis(numbers, offset.at(static_cast<std::size_t>(numbers.axis)));
    }
    case NodeInput::Kind::uniform: break;
  }
  return uniform(input.number);
}

std::vector<NodeInput> NodeFormulas::inputs_of(formula::Expression formula) const {
  std::vector<NodeInput> found;
  const auto numbers = formula::variables_of(formula);
  std::ranges::copy_if(inputs_, std::back_inserter(found), [&](const NodeInput& input) {
    return std::ranges::binary_search(numbers, formula::variables_of(input.variable).front());
  });
  return found;
}

std::array<int, 3> NodeFormulas::middle_of(formula::Expression formula, const Shift& shift) const {
  std::optional<std::array<int, 3>> first, last;
  for (const NodeInput& input : inputs_of(formula)) {
    if (input.kind == NodeInput::Kind::node) {
      std::array<int, 3> place = shift(input);
      for (std::size_t a = 0; a < place.size(); ++a) {
        place[a] += 2 * input.offset[a];
      }
      first = first.value_or(place);
      last = last.value_or(place);
      for (std::size_t a = 0; a < place.size(); ++a) {
        (*first)[a] = std::min((*first)[a], place[a]);
        (*last)[a] = std::max((*last)[a], place[a]);
      }
    }
  }
  std::array<int, 3> middle{};
  for (std::size_t a = 0; first && a < middle.size(); ++a) {
    middle[a] = ((*first)[a] + (*last)[a]) / 2;
  }
  return middle;
}

formula::Expression NodeFormulas::between_walls(formula::Expression term, const std::array<int, 3>& middle) {
  for (int a = 0; a < grid_.dimensions(); ++a) {
    const grids::Axis& axis = grid_.axis(a);
    if (axis.ghosts == 0) {
      continue;
    }
    const int twice = middle.at(static_cast<std::size_t>(a)), odd = twice & 1;
    PlaceNumbers part{a, std::vector<double>(axis.cells, 0.0)};
    for (std::size_t i = 0; i < axis.cells; ++i) {
      const bool is_within = !axis.is_ghost(i) && (odd == 0 || !axis.is_on_wall(i, true));
      part.values[i] = !is_within ? 0.0 : odd == 0 && axis.is_on_wall(i) ? 0.5 : 1.0;
    }
    term = along_axis(part, (twice - odd) / 2) * term;
  }
  return term;
}

formula::Expression NodeFormulas::between_walls(formula::Expression sum, const Shift& shift) {
  if (!grid_.has_ghosts()) {
    return sum;
  }
  const WeightedTerms terms(sum);
  TermsByMiddle by_middle;
  for (const auto& [term, weight] : terms.terms()) {
    by_middle.add(term, weight, middle_of(term, shift));
  }
  return by_middle.sum(*this);
}

void add_weighted(formula::Expression& sum, double weight, const formula::Expression& term) {
  if (term.is_constant() && term.constant_value() == 0.0) {
    return;
  }
  const bool is_sign = weight == 1.0 || weight == -1.0;
  const formula::Expression part = is_sign ? term : std::abs(weight) * term;
  if (!sum.valid()) {
    sum = weight < 0.0 ? -part : part;
  } else {
    sum = weight < 0.0 ? sum - part : sum + part;
  }
}

}  // namespace rubato
