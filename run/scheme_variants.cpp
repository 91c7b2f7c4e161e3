#include <rubato/run/scheme_variants.hpp>

#include <algorithm>
#include <array>
#include <functional>

#include <fmt/format.h>

#include <rubato/ode/orbit_methods.hpp>
#include <rubato/problem/effective.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

namespace {

std::string in_quotes(std::string_view word) {
  return fmt::format("\"{}\"", word);
}

/// A value of one key, and what it makes of a variant.
struct Option {
  std::string value;  ///< as TOML; empty: the key is left out
  double stages = 1.0;
  std::function<void(LatticeMethodChoice&)> choose = [](LatticeMethodChoice&) {};
};

/// Every variant with every option.
void multiply(std::vector<SchemeVariant>& variants, const std::string& key, const std::vector<Option>& options) {
  std::vector<SchemeVariant> all;
  for (const SchemeVariant& variant : variants) {
    for (const Option& option : options) {
      SchemeVariant& one = all.emplace_back(variant);
      one.stages *= option.stages;
      if (!option.value.empty()) {
        one.entries.emplace_back(key, option.value);
      }
      if (one.lattice) {
        option.choose(*one.lattice);
      }
    }
  }
  variants = std::move(all);
}

/// Gauss collocation has one stage where `stages` is left out.
std::vector<Option> stage_options(std::initializer_list<int> counts) {
  std::vector<Option> options;
  for (const int stages : counts) {
    options.push_back({.value = stages > 1 ? std::to_string(stages) : "",
                       .stages = static_cast<double>(stages),
                       .choose = [stages](LatticeMethodChoice& choice) { choice.stages = stages; }});
  }
  return options;
}

std::vector<Option> composition_options(bool first_of_each_order) {
  std::vector<Option> options;
  for (const Composition& one : compositions()) {
    if (first_of_each_order && composition_of_order(one.order).name != one.name) {
      continue;
    }
    options.push_back({.value = in_quotes(one.name),
                       .stages = static_cast<double>(one.parts.size()),
                       .choose = [name = one.name](LatticeMethodChoice& choice) { choice.composition = name; }});
  }
  return options;
}

SchemeVariant plain(std::string_view word) {
  return {.family = std::string(word), .entries = {{"lagrangian", in_quotes(word)}}};
}

void add_orbit_variants(const HamiltonianProblem& orbit, std::vector<SchemeVariant>& all) {
  for (const std::string_view word : orbit.L ? quadratures() : hamiltonian_lagrangians()) {
    const OrbitMethod& method = *std::ranges::find(orbit_methods(), word, &OrbitMethod::name);
    if (!orbit.L && method.scheme == nullptr) {
      continue;
    }
    std::vector<SchemeVariant> variants = {plain(word)};
    if (method.has_stages) {
      multiply(variants, "stages", stage_options({2, 3, 4}));
    }
    if (method.has_compositions) {
      multiply(variants, "composition", composition_options(false));
    }
    if (method.has_orders) {
      multiply(variants, "order", {{.value = "4", .stages = 4.0}, {.value = "6", .stages = 6.0}});
    }
    all.insert(all.end(), variants.begin(), variants.end());
  }
}

void add_lattice_variants(std::vector<SchemeVariant>& all) {
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    std::vector<SchemeVariant> variants = {plain(entry.name)};
    variants.front().lattice = LatticeMethodChoice{.name = std::string(entry.name)};
    if (entry.has_stages) {
      multiply(variants, "stages", stage_options({1, 2}));
    }
    if (entry.has_space_stages) {
      multiply(
          variants, "space_stages",
          {{}, {.value = "3", .stages = 3.0, .choose = [](LatticeMethodChoice& choice) { choice.space_stages = 3; }}});
    }
    if (entry.has_compositions) {
      multiply(variants, "composition", composition_options(true));
    }
    if (entry.has_space) {
      std::vector<Option> options;
      for (const std::string_view space : space_words) {
        options.push_back(
            {.value = in_quotes(space), .choose = [space](LatticeMethodChoice& choice) { choice.space = space; }});
      }
      multiply(variants, "space", options);
      for (SchemeVariant& variant : variants) {
        variant.family += " " + variant.lattice->space;
      }
    }
    all.insert(all.end(), variants.begin(), variants.end());
  }
}

}  // namespace

SchemeVariant SchemeVariant::with(Levels levels) const {
  SchemeVariant variant = *this;
  variant.entries.emplace_back("levels", in_quotes(to_string(levels)));
  return variant;
}

std::vector<SchemeVariant> scheme_variants(const Problem& problem) {
  std::vector<SchemeVariant> variants;
  if (const HamiltonianProblem* const orbit = problem.hamiltonian()) {
    add_orbit_variants(*orbit, variants);
  } else {
    add_lattice_variants(variants);
  }
  return variants;
}

std::string unquoted(const std::string& value) {
  return value.starts_with('"') ? value.substr(1, value.size() - 2) : value;
}

std::string without_scheme(const Problem& problem) {
  constexpr std::array<std::string_view, 6> of_any_scheme = {"step",  "until",     "time_scale",
                                                             "frame", "max_steps", "tolerance"};
  std::string text = without(problem.text, problem.source, "initial.next");
  for (const KeyEntry& key : problem_keys()) {
    if (key.table == "scheme" && std::ranges::find(of_any_scheme, key.name) == of_any_scheme.end()) {
      text = without(text, problem.source, fmt::format("scheme.{}", key.name));
    }
  }
  return text;
}

}  // namespace rubato
