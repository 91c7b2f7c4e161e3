#include <rubato/pde/lattice_method.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/mirrored_method.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

#define RUBATO_LATTICE_METHOD(name) [[nodiscard]] LatticeMethodEntry name##_method();
#include <rubato/pde/schemes/registry.inc>
#undef RUBATO_LATTICE_METHOD

bool LatticeMethod::begins_in_parts(const MultisymplecticSystem& system, const std::vector<bool>& given) const {
  for (std::size_t f = 0; f < given.size(); ++f) {
    if (given[f] == system.structure().algebraic[f]) {
      return false;
    }
  }
  return true;
}

std::optional<LatticeMethod::OtherCount> LatticeMethod::other_count(std::size_t, int) const {
  return std::nullopt;
}

std::size_t LatticeMethod::count_near(std::size_t wanted, int dimensions) const {
  constexpr std::size_t least = 3;
  const bool transforms = has_transforms(dimensions);
  const auto is_good = [&](std::size_t n) {
    return n >= least && !other_count(n, dimensions) && (!transforms || grids::has_small_factors(n));
  };
  for (std::size_t away = 0;; ++away) {
    if (is_good(wanted + away)) {
      return wanted + away;
    }
    if (away < wanted && is_good(wanted - away)) {
      return wanted - away;
    }
  }
}

std::span<const LatticeMethodEntry> lattice_methods() {
#define RUBATO_LATTICE_METHOD(name) name##_method(),
  static const LatticeMethodEntry all[] = {
#include <rubato/pde/schemes/registry.inc>
  };
#undef RUBATO_LATTICE_METHOD
  return all;
}

const LatticeMethodEntry& lattice_method_entry(std::string_view name) {
  if (name == custom_lattice_method().name) {
    return custom_lattice_method();
  }
  const auto all = lattice_methods();
  const auto found = std::ranges::find(all, name, &LatticeMethodEntry::name);
  if (found == all.end()) {
    std::vector<std::string_view> names;
    for (const LatticeMethodEntry& entry : all) {
      names.push_back(entry.name);
    }
    names.push_back(custom_lattice_method().name);
    throw std::invalid_argument(
        fmt::format("\"{}\" is no scheme for lattices; there are \"{}\"", name, fmt::join(names, "\", \"")));
  }
  return *found;
}

std::unique_ptr<LatticeMethod> make_lattice_method(const LatticeMethodChoice& choice) {
  const LatticeMethodEntry& entry = lattice_method_entry(choice.name);
  if (choice.stages != 1 && !entry.has_stages) {
    throw std::invalid_argument(fmt::format("stages = {}: {} has one stage", choice.stages, entry.name));
  }
  if (choice.stages < 1 || choice.stages > GaussTableau::most_stages) {
    throw std::invalid_argument(fmt::format("stages = {}: Gauss collocation is made for 1 to {} stages", choice.stages,
                                            GaussTableau::most_stages));
  }
  if (choice.space_stages != 1 && !entry.has_space_stages) {
    throw std::invalid_argument(fmt::format("space_stages = {}: {} has one point in each cell of space, or none",
                                            choice.space_stages, entry.name));
  }
  if (choice.space_stages < 1 || choice.space_stages > most_space_stages) {
    throw std::invalid_argument(fmt::format("space_stages = {}: Gauss collocation in space is made for 1 to {} stages",
                                            choice.space_stages, most_space_stages));
  }
  if (choice.space_stages % 2 == 0) {
    throw std::invalid_argument(fmt::format("space_stages = {}: {}; take space_stages = {} or {}", choice.space_stages,
                                            space_rule_objection({.stages = choice.space_stages}, 0),
                                            choice.space_stages - 1, choice.space_stages == 2 ? 3 : 1));
  }
  if (std::ranges::find(space_words, choice.space) == space_words.end() ||
      (choice.space != space_words.front() && !entry.has_space)) {
    throw std::invalid_argument(fmt::format("space = \"{}\": {} has {}", choice.space, entry.name,
                                            entry.has_space ? fmt::format("\"{}\"", fmt::join(space_words, "\" and \""))
                                                            : std::string("no choice of derivatives in space")));
  }
  return entry.make(choice);
}

std::unique_ptr<LatticeMethod> make_lattice_method(const LatticeMethodChoice& choice, const grids::Grid& grid) {
  auto method = make_lattice_method(choice);
  return grid.has_walls() ? make_mirrored_method(std::move(method), choice) : std::move(method);
}

LocalLaws make_local_laws(const LatticeMethod& method, const MultisymplecticSystem& system, const grids::Grid& grid,
                          const std::vector<LinearSymmetry>& symmetries) {
  LawTables tables(system, grid, symmetries);
  std::vector<std::string> names = tables.names;
  return {std::move(names), [&method, tables = std::move(tables)] { return method.laws(tables); }};
}

}  // namespace rubato
