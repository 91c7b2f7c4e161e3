#include <rubato/report/summary.hpp>

#include <algorithm>
#include <cmath>
#include <span>

#include <fmt/format.h>

#include <rubato/base/larger.hpp>
#include <rubato/record/error.hpp>

namespace rubato::report {

namespace {

/// A number to three digits, or that there is none.
std::string figure(double value) {
  return std::isfinite(value) ? fmt::format("{:.3g}", value) : "undefined";
}

Summary::Range range_of(std::span<const double> values) {
  const auto [min, max] = std::ranges::minmax(values);
  return {min, max};
}

Summary::Deviation deviation_of(std::string name, std::span<const double> values) {
  Summary::Deviation deviation{.name = std::move(name), .initial = values.empty() ? 0.0 : values.front()};
  for (const double value : values) {
    deviation.max = larger(deviation.max, std::abs(value - deviation.initial));
  }
  return deviation;
}

/// Steps without a value (NaN) do not count. Every step of a residual has equally many cells, so that the mean square
/// over all is the mean over steps.
Summary::MaxRms residual_of(const record::Reader& reader, const std::string& name) {
  Summary::MaxRms residual{.name = name};
  for (const double max : reader.read("/laws/" + name + "_max")) {
    residual.max = std::max(residual.max, max);
  }
  double squares = 0.0;
  std::size_t count = 0;
  for (const double rms : reader.read("/laws/" + name + "_rms")) {
    if (std::isfinite(rms)) {
      squares += rms * rms;
      ++count;
    }
  }
  residual.rms = count == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(count));
  return residual;
}

/// The last row of a coordinate or a field that [exact] names.
std::vector<double> last_state(const record::Reader& reader, const Contents& contents, const std::string& name) {
  const std::size_t last = reader.rows("/states/t") - 1;
  for (const auto& [names, path] : {std::pair(&contents.coordinates, "/states/q"), {&contents.momenta, "/states/p"}}) {
    if (const auto found = std::ranges::find(*names, name); found != names->end()) {
      return {reader.read(path, last, 1).at(static_cast<std::size_t>(found - names->begin()))};
    }
  }
  const auto field = std::ranges::find(contents.fields, name, &Contents::Field::name);
  return field == contents.fields.end() || field->at_midpoints ? std::vector<double>()
                                                               : reader.read(field->path, last, 1);
}

std::vector<Summary::MaxRms> errors_of(const record::Reader& reader, const Contents& contents) {
  std::vector<Summary::MaxRms> errors;
  for (const std::string& name : contents.exact) {
    const std::vector<double> state = last_state(reader, contents, name);
    const std::vector<double> exact = reader.read("/exact/" + name, reader.rows("/exact/" + name) - 1, 1);
    if (state.size() != exact.size()) {
      continue;
    }
    Summary::MaxRms error{.name = name};
    for (std::size_t i = 0; i < state.size(); ++i) {
      error.max = larger(error.max, std::abs(state[i] - exact[i]));
      error.rms += (state[i] - exact[i]) * (state[i] - exact[i]) / static_cast<double>(state.size());
    }
    error.rms = std::sqrt(error.rms);
    errors.push_back(error);
  }
  return errors;
}

/// \throws record::Error if what is said of levels and of steps is not of one length
void check_sizes(const record::Reader& reader, std::size_t levels) {
  const auto check = [&](const char* path, std::size_t rows) {
    if (reader.rows(path) != rows) {
      throw record::Error(reader.file(),
                          fmt::format("{} has {} rows, and {} levels need {}", path, reader.rows(path), levels, rows));
    }
  };
  for (const char* path : {"/levels/gamma", "/levels/node_energy"}) {
    check(path, levels);
  }
  for (const char* path : {"/levels/h", "/levels/energy", "/levels/bridged", "/levels/iterations"}) {
    check(path, levels - 1);
  }
}

void add_steps(Summary& summary, const record::Reader& reader) {
  const std::vector<double> energy = reader.read("/levels/energy");
  const std::vector<double> bridged = reader.read("/levels/bridged");
  const std::vector<double> iterations = reader.read("/levels/iterations");
  summary.steps = energy.size();
  summary.h = range_of(reader.read("/levels/h"));
  summary.discrete_energy.initial = energy.front();
  for (std::size_t k = 0; k < energy.size(); ++k) {
    double& deviation = bridged[k] != 0.0 ? summary.bridge_deviation : summary.discrete_energy.max;
    deviation = std::max(deviation, std::abs(energy[k] - energy.front()));
    summary.bridge_steps += bridged[k] != 0.0 ? 1 : 0;
    summary.mean_iterations += iterations[k] / static_cast<double>(energy.size());
    summary.most_iterations = std::max(summary.most_iterations, iterations[k]);
  }
  for (const double condition : reader.read("/levels/step_condition")) {
    summary.step_condition = std::max(summary.step_condition, condition);
  }
}

}  // namespace

Summary summarise(const record::Reader& reader, const Contents& contents) {
  Summary summary;
  summary.finished = reader.header().finished;
  const std::size_t levels = reader.rows("/levels/t");
  summary.t_first = reader.read("/levels/t", 0, 1).front();
  summary.t_last = reader.read("/levels/t", levels - 1, 1).front();
  check_sizes(reader, levels);
  const std::vector<double> node_energy = reader.read("/levels/node_energy");
  summary.node_energy = deviation_of("node energy", node_energy);
  summary.gamma = range_of(reader.read("/levels/gamma"));
  if (levels > 1) {
    add_steps(summary, reader);
  }
  summary.energy_scale = std::abs(summary.discrete_energy.initial);
  for (const double energy : node_energy) {
    summary.energy_scale = std::max(summary.energy_scale, std::abs(energy));
  }
  for (const std::string& name : contents.invariants) {
    summary.invariants.push_back(deviation_of(name, reader.read("/laws/" + name)));
  }
  for (const std::string& name : contents.totals) {
    summary.totals.push_back(deviation_of(name, reader.read("/laws/totals/" + name)));
  }
  for (const std::string& name : contents.residuals) {
    summary.residuals.push_back(residual_of(reader, name));
  }
  summary.errors = errors_of(reader, contents);
  return summary;
}

std::vector<Line> lines_of(const Summary& summary) {
  const auto range = [](const Summary::Range& values) {
    return fmt::format("{:.4g} to {:.4g}", values.min, values.max);
  };
  std::vector<Line> lines;
  lines.push_back({"steps", fmt::format("{}", summary.steps),
                   fmt::format("t = {:.8g} to {:.8g}{}", summary.t_first, summary.t_last,
                               summary.finished ? "" : " (not finished)"),
                   true});
  if (summary.h) {
    lines.push_back({"step length", range(*summary.h), "", true});
    lines.push_back({"discrete energy, relative deviation",
                     fmt::format("{:.2g}", summary.relative(summary.discrete_energy.max)),
                     fmt::format("E_0 = {:.10g}", summary.discrete_energy.initial), true});
  }
  lines.push_back({"node energy, deviation", fmt::format("{:.3g}", summary.node_energy.max),
                   fmt::format("H(z_0) = {:.10g}", summary.node_energy.initial), true});
  lines.push_back({"Gamma", range(summary.gamma), "", true});
  lines.push_back({"bridging steps", summary.bridge_steps == 0 ? "none" : fmt::format("{}", summary.bridge_steps),
                   summary.bridge_steps == 0
                       ? ""
                       : fmt::format("E_k off by up to {:.2g} there", summary.relative(summary.bridge_deviation)),
                   true});
  lines.push_back({"step condition", fmt::format("{:.2g}", summary.step_condition), "relative error of h, at most"});
  lines.push_back({"iterations per step", fmt::format("{:.3g}", summary.mean_iterations),
                   fmt::format("at most {}", summary.most_iterations)});
  for (const Summary::MaxRms& residual : summary.residuals) {
    lines.push_back({"residual " + residual.name + ", largest", fmt::format("{:.3g}", residual.max),
                     fmt::format("rms {:.3g}", residual.rms)});
  }
  for (const auto* deviations : {&summary.totals, &summary.invariants}) {
    for (const Summary::Deviation& deviation : *deviations) {
      lines.push_back({(deviations == &summary.totals ? "total " : "") + deviation.name + ", deviation",
                       figure(deviation.max), fmt::format("first value {:.10g}", deviation.initial)});
    }
  }
  for (const Summary::MaxRms& error : summary.errors) {
    lines.push_back({"error in " + error.name + ", largest", figure(error.max),
                     fmt::format("rms {}, last stored level", figure(error.rms)), true});
  }
  return lines;
}

}  // namespace rubato::report
