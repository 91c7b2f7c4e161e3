#include "records.hpp"

#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include <fmt/format.h>

#include <rubato/record/writer.hpp>

namespace sample {

namespace {

namespace record = rubato::record;
using record::Type;

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

/// Publishes only at the end.
constexpr record::CommitPolicy once{.interval = std::chrono::hours(1)};

record::Layout common_layout(const std::string& title, const std::string& problem) {
  return {.title = title,
          .problem = problem,
          .version = "0.1.0",
          .compiler = "g++",
          .threads = 2,
          .scales = {},
          .datasets = {{"/levels/t", "/levels/t"},
                       {"/levels/gamma", "/levels/t"},
                       {"/levels/node_energy", "/levels/t"},
                       {"/levels/step", "/levels/step", {}, Type::i64},
                       {"/levels/h", "/levels/step"},
                       {"/levels/energy", "/levels/step"},
                       {"/levels/iterations", "/levels/step", {}, Type::i32},
                       {"/levels/off_law", "/levels/step", {}, Type::u8},
                       {"/levels/step_condition", "/levels/step", {}, Type::f64, "", true},
                       {"/laws/momentum", "/levels/t", {}, Type::f64, "", true},
                       {"/laws/energy_max", "/levels/step"},
                       {"/laws/energy_rms", "/levels/step"},
                       {"/states/t", "/states/t"},
                       {"/states/level", "/states/t", {}, Type::i64}}};
}

double time_of(std::size_t level) {
  const auto k = static_cast<double>(level);
  return 0.1 * k + 0.02 * std::sin(0.1 * k);
}

/// What belongs to the level, to the step that led to it, and to its stored state; answers the next dataset's number.
std::size_t append_common(record::Writer& writer, std::size_t level, bool off_law, double node_energy,
                          bool is_momentum_undefined = false) {
  const double t = time_of(level);
  writer.append(0, t);
  writer.append(1, 1.5 + std::sin(t));
  writer.append(2, node_energy);
  if (level > 0) {
    writer.append(3, static_cast<std::int64_t>(level - 1));
    writer.append(4, t - time_of(level - 1));
    writer.append(5, 0.5 + 1e-15 * std::sin(37.0 * t) + (off_law ? 1e-4 : 0.0));
    writer.append(6, static_cast<std::int64_t>(5 + level % 3));
    writer.append(7, off_law ? 1 : 0);
    writer.append(8, 1e-13 * (1.5 + std::cos(t)));
    writer.append(10, 1e-4 * (1.1 + std::sin(t)));
    writer.append(11, 1e-5 * (1.1 + std::sin(t)));
  }
  writer.append(9, is_momentum_undefined ? undefined : 2.0 + 1e-14 * std::cos(t));
  writer.append(12, t);
  writer.append(13, static_cast<std::int64_t>(level));
  return 14;
}

}  // namespace

void write_orbit(const std::filesystem::path& file, const OrbitRecord& orbit) {
  record::Layout layout = common_layout(orbit.title, orbit.problem);
  std::vector<std::string> q, p;
  for (std::size_t i = 1; i <= orbit.dimension; ++i) {
    q.push_back(orbit.names.empty() ? fmt::format("q{}", i) : orbit.names.at(i - 1));
    p.push_back(orbit.names.empty() ? fmt::format("p{}", i) : "p_" + q.back());
  }
  layout.scales = {{"/states/coordinate", q}, {"/states/momentum", p}};
  layout.datasets.push_back({"/states/q", "/states/t", {"/states/coordinate"}});
  layout.datasets.push_back({"/states/p", "/states/t", {"/states/momentum"}});
  const bool has_exact = orbit.with_exact && orbit.names.empty();
  if (has_exact) {
    layout.datasets.push_back({"/exact/q1", "/states/t"});
  }
  if (orbit.crossings > 0) {
    const std::string at = "/events/section";
    layout.scales.push_back({at + "/quantity", std::vector<std::string>{"y", "v"}});
    layout.datasets.push_back({at + "/missed", "/levels/step", {}, Type::u8});
    layout.datasets.push_back({at + "/t", at + "/t"});
    layout.datasets.push_back({at + "/direction", at + "/t", {}, Type::i32});
    layout.datasets.push_back({at + "/quantities", at + "/t", {at + "/quantity"}});
  }
  auto writer = record::Writer::create(file, layout, true, once);
  for (std::size_t level = 0; level <= orbit.steps; ++level) {
    const double t = time_of(level);
    const bool off_law = orbit.with_off_law && level % 100 >= 50 && level % 100 < 53;
    const double energy = 0.5 + 1e-3 * std::cos(t) + (orbit.spike != 0 && level == orbit.spike ? 1.0 : 0.0);
    std::size_t next = append_common(writer, level, off_law, energy);
    std::vector<double> position, momentum;
    for (std::size_t i = 1; i <= orbit.dimension; ++i) {
      const double phase = orbit.frequency * static_cast<double>(i) * t;
      position.push_back(orbit.size * std::sin(phase));
      momentum.push_back(std::cos(phase));
    }
    writer.append(next++, position);
    writer.append(next++, momentum);
    if (has_exact) {
      writer.append(next++, std::sin(orbit.frequency * t) + 1e-4 * t);
    }
    if (orbit.crossings > 0 && level > 0) {
      writer.append(next++, 0);
      for (std::size_t i = 0; i < orbit.crossings; ++i) {
        writer.append(next, t);
        writer.append(next + 1, 1);
        writer.append(next + 2, std::vector{std::sin(t), std::cos(37.0 * t)});
      }
    }
    writer.end_level();
  }
  writer.finish({}, record::Writer::Completion::complete);
}

void write_lattice(const std::filesystem::path& file, const LatticeRecord& lattice) {
  record::Layout layout = common_layout(lattice.title, R"(title = ")" + lattice.title + "\"\n");
  std::vector<std::string> nodes, cells;
  std::size_t count = 1;  // of cells
  for (const auto& [name, size] : {std::pair("z", lattice.nz), {"y", lattice.ny}, {"x", lattice.nx}}) {
    if (size == 1) {
      continue;
    }
    std::vector<double> at, middle;
    for (std::size_t i = 0; i < size; ++i) {
      at.push_back(-5.0 + 10.0 * static_cast<double>(i) / static_cast<double>(size));
      middle.push_back(at.back() + 5.0 / static_cast<double>(size));
    }
    const std::string path = std::string("/grid/") + name;
    layout.scales.push_back({path, at});
    middle.resize(size - (lattice.walls ? 1 : 0));
    layout.scales.push_back({path + "_cell", middle});
    count *= middle.size();
    nodes.push_back(path);
    cells.push_back(path + "_cell");
  }
  layout.datasets.push_back({"/states/" + lattice.field, "/states/t", nodes});
  if (!lattice.other_field.empty()) {
    layout.datasets.push_back({"/states/" + lattice.other_field, "/states/t", nodes});
  }
  layout.datasets.push_back({"/exact/" + lattice.field, "/states/t", nodes, Type::f64, "", true});
  layout.datasets.push_back({"/laws/fields/energy", "/states/t", cells, Type::f64, "", true});
  auto writer = record::Writer::create(file, layout, true, once);
  const std::size_t size = lattice.nx * lattice.ny * lattice.nz;
  std::vector<double> field(size), exact(size), residual(size);
  for (std::size_t level = 0; level < lattice.levels; ++level) {
    const double t = time_of(level);
    for (std::size_t i = 0; i < size; ++i) {
      const double x = -5.0 + 10.0 * static_cast<double>(i % lattice.nx) / static_cast<double>(lattice.nx);
      const double y = -5.0 + 10.0 * static_cast<double>(i / lattice.nx % lattice.ny) / static_cast<double>(lattice.ny);
      const double r = x * x + (lattice.ny > 1 ? y * y : 0.0);
      exact[i] = std::cos(t) / (1.0 + r);
      field[i] = exact[i] + 1e-3 * t * x / (1.0 + r);
      residual[i] = level == 0 ? undefined : lattice.residual * std::exp(-r) * std::sin(t + x);
    }
    const bool has_hole = lattice.undefined_every != 0 && level > 0 && level % lattice.undefined_every == 0;
    if (has_hole) {
      residual[level % size] = undefined;
    }
    if (lattice.spike_level != 0 && level == lattice.spike_level) {
      field[lattice.spike_cell] = 100.0;
    }
    std::size_t next = append_common(writer, level, false, 0.5 + 1e-3 * std::cos(t), has_hole);
    writer.append(next++, field);
    if (!lattice.other_field.empty()) {
      writer.append(next++, exact);
    }
    writer.append(next++, exact);
    writer.append(next++, std::span(residual).first(count));
    writer.end_level();
  }
  writer.finish({}, record::Writer::Completion::complete);
}

}  // namespace sample
