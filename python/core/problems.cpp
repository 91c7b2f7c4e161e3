#include "core.hpp"

#include <rubato/formula/language.hpp>
#include <rubato/problem/effective.hpp>
#include <rubato/problem/keys.hpp>

namespace rubato::python {

namespace {

/// Lets a lattice begin from `arrays`: its text says `from`, `at` and `take`.
void take_arrays(BoundProblem& bound, const std::map<std::string, Array>& arrays) {
  auto* const pde = std::get_if<MultisymplecticProblem>(&bound.problem.system);
  if (arrays.empty()) {
    return;
  }
  if (pde == nullptr || !pde->initial_record) {
    throw std::invalid_argument("initial arrays are for the fields of a lattice");
  }
  std::vector<std::size_t> shape;
  for (const GridAxis& axis : pde->axes) {
    shape.insert(shape.begin(), static_cast<std::size_t>(axis.nodes()));
  }
  for (const auto& [name, array] : arrays) {
    const std::vector<std::size_t> given(array.shape(), array.shape() + array.ndim());
    if (given != shape) {
      throw std::invalid_argument(fmt::format("the initial {} has shape ({}), and the grid ({})", name,
                                              fmt::join(given, ", "), fmt::join(shape, ", ")));
    }
    const std::span<const double> values(array.data(), static_cast<std::size_t>(array.size()));
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (!std::isfinite(values[i])) {
        throw std::invalid_argument(fmt::format("the initial {} is {} at node {}", name, values[i], i));
      }
    }
    pde->initial_record->arrays.emplace(name, values);
    bound.arrays.push_back(array);
  }
}

SharedProblem parse(const std::string& text, const std::string& source, const std::vector<std::string>& settings,
                    const std::map<std::string, Array>& arrays) {
  auto bound = std::make_shared<BoundProblem>();
  {
    const py::gil_scoped_release released;
    bound->problem = parse_problem(text, source, settings);
  }
  take_arrays(*bound, arrays);
  return bound;
}

py::list axes_of(const BoundProblem& bound) {
  py::list axes;
  if (const auto* pde = bound.problem.multisymplectic()) {
    for (const GridAxis& axis : pde->axes) {
      axes.append(py::make_tuple(axis.name, axis.from, axis.to, axis.cells));
    }
  }
  return axes;
}

std::vector<std::string> event_names(const BoundProblem& bound) {
  std::vector<std::string> names;
  for (const StatedEvent& event : bound.problem.events) {
    names.push_back(event.name);
  }
  return names;
}

py::list keys() {
  py::list all;
  for (const KeyEntry& key : problem_keys()) {
    all.append(py::make_tuple(std::string(key.table), std::string(key.name), std::string(key.type), key.meaning));
  }
  return all;
}

}  // namespace

void define_problems(py::module_& module) {
  const auto orbit = [](const BoundProblem& bound) { return bound.problem.hamiltonian(); };
  const auto pde = [](const BoundProblem& bound) { return bound.problem.multisymplectic(); };
  using Names = std::vector<std::string>;
  py::class_<BoundProblem, std::shared_ptr<BoundProblem>>(module, "Problem")
      .def_property_readonly("name", [](const BoundProblem& bound) { return bound.problem.name; })
      .def_property_readonly("title", [](const BoundProblem& bound) { return bound.problem.title; })
      .def_property_readonly("text", [](const BoundProblem& bound) { return bound.problem.text; })
      .def_property_readonly("file", [](const BoundProblem& bound) { return bound.problem.output.file; })
      .def_property_readonly("is_lattice", [=](const BoundProblem& bound) { return pde(bound) != nullptr; })
      .def_property_readonly("is_ensemble",
                             [](const BoundProblem& bound) { return bound.problem.ensemble.has_value(); })
      .def_property_readonly("q", [=](const BoundProblem& bound) { return orbit(bound) ? orbit(bound)->q : Names(); })
      .def_property_readonly("p", [=](const BoundProblem& bound) { return orbit(bound) ? orbit(bound)->p : Names(); })
      .def_property_readonly("q_dot",
                             [=](const BoundProblem& bound) { return orbit(bound) ? orbit(bound)->q_dot : Names(); })
      .def_property_readonly("pairs",
                             [=](const BoundProblem& bound) {
                               const HamiltonianProblem& stated = *orbit(bound);
                               return stated.q.size() - (stated.driven || stated.fictitious_time ? 1 : 0);
                             })
      .def_property_readonly("has_frame",
                             [](const BoundProblem& bound) { return bound.problem.scheme.frame.has_value(); })
      .def_property_readonly("has_clock", [](const BoundProblem& bound) { return bound.problem.clock().has_value(); })
      .def_property_readonly("fields",
                             [=](const BoundProblem& bound) { return pde(bound) ? pde(bound)->fields : Names(); })
      .def_property_readonly("unknowns",
                             [=](const BoundProblem& bound) {
                               py::list all;
                               if (pde(bound) != nullptr) {
                                 for (const StatedUnknown& one : pde(bound)->unknowns) {
                                   all.append(py::make_tuple(one.name, one.rate, one.re, one.im));
                                 }
                               }
                               return all;
                             })
      .def_property_readonly("form", [=](const BoundProblem& bound) { return pde(bound) ? pde(bound)->derived : ""; })
      .def_property_readonly("axes", &axes_of)
      .def_property_readonly("events", &event_names)
      .def_property_readonly("start", [](const BoundProblem& bound) { return bound.problem.start(); })
      .def_property_readonly("until", [](const BoundProblem& bound) { return bound.problem.scheme.until; })
      .def_property_readonly("step", [](const BoundProblem& bound) { return bound.problem.scheme.step; });
  module.def("parse_problem", &parse, py::arg("text"), py::arg("source"), py::arg("settings"), py::arg("arrays"));
  module.def("read_problem", [](const std::string& name, const std::vector<std::string>& settings) {
    auto bound = std::make_shared<BoundProblem>();
    const py::gil_scoped_release released;
    bound->problem = read_problem(name, settings);
    return bound;
  });
  module.def("catalogue", [] {
    py::list items;
    for (const CatalogueItem& item : list_catalogue()) {
      items.append(py::make_tuple(item.name, item.title, item.is_lattice));
    }
    return items;
  });
  module.def("show", [](const std::string& name, const std::vector<std::string>& settings) {
    return effective_document(show_catalogue(name), name + ".toml (built-in)", settings).text;
  });
  module.def("help_text", [](const std::string& topic) { return help_text(topic); });
  module.def("problem_keys", &keys);
  module.def("functions", [] {
    std::vector<std::string> names;
    for (const formula::Function& function : formula::functions()) {
      names.emplace_back(function.name);
    }
    return names;
  });
  module.def("did_you_mean",
             [](const std::string& word, const std::vector<std::string>& known) { return did_you_mean(word, known); });
}

}  // namespace rubato::python
