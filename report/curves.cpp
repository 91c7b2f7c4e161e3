#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include <fmt/format.h>

#include <rubato/record/error.hpp>
#include <rubato/record/run_shape.hpp>
#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

/// What the values of a curve belong to: levels, the middle of steps, or stored levels.
enum class Axis { levels, steps, states };
constexpr std::array axis_names{"levels", "steps", "states"};

/// Both ends of every step that has a row: from the level before, or, where that has none, by its length.
std::vector<std::pair<double, double>> steps_of(const record::Reader& reader) {
  const std::vector<double> t = level_times(reader), number = reader.read("/levels/step");
  std::vector<double> h = reader.read("/levels/h");
  if (reader.has(std::string(figures::level_times))) {
    h.assign(h.size(), 0.0);  // steps are of fictitious time
  }
  std::vector<std::pair<double, double>> steps;
  for (std::size_t k = 0; k < std::min({h.size(), number.size(), t.size() - std::min<std::size_t>(t.size(), 1)}); ++k) {
    const bool follows = number[k] == (k == 0 ? 0.0 : number[k - 1] + 1.0);
    steps.emplace_back(follows ? t[k] : t[k + 1] - h[k], t[k + 1]);
  }
  return steps;
}

/// The first value that there is; 0 if there is none.
double first_defined(std::span<const double> values) {
  const auto found = std::ranges::find_if(values, [](double value) { return std::isfinite(value); });
  return found == values.end() ? 0.0 : *found;
}

class CurveWriter {
public:
  CurveWriter(Json& json, const Source& source, const Resolution& resolution)
      : json_(json), source_(source), points_(resolution.curve_points) {
    times_[0] = level_times(source.reader);
    for (const auto& [from, to] : steps_of(source.reader)) {
      times_[1].push_back(from + (to - from) / 2);
    }
    times_[2] = state_times(source.reader);
    if (const std::string path(figures::laws_taken); source.reader.has(path)) {
      const std::vector<double> taken = source.reader.read(path);
      for (std::size_t k = 0; k < taken.size(); ++k) {
        if (taken[k] != 0.0) {
          with_laws_[0].push_back(k);
          with_laws_[1].insert(with_laws_[1].end(), k > 0 ? 1 : 0, k - 1);
        }
      }
    }
  }

  void values(std::string_view name, std::string_view group, Axis axis, const std::string& path) {
    write(name, group, axis, path, source_.reader.read(path), 0.0);
  }
  /// Their deviations from `initial`; if that is not given or undefined, from the first that there is.
  void deviations(std::string_view name, std::string_view group, Axis axis, const std::string& path,
                  std::optional<double> initial = {}) {
    std::vector<double> y = source_.reader.read(path);
    const double from = initial && std::isfinite(*initial) ? *initial : first_defined(y);
    std::ranges::for_each(y, [from](double& value) { value -= from; });
    write(name, group, axis, path, std::move(y), from);
  }
  /// A quantity of the user's, at times of its own.
  void at_output_times(std::string_view name, const std::string& path) {
    const std::vector<double> t = source_.reader.read("/output/t"), y = source_.reader.read(path);
    if (y.empty() || y.size() != t.size()) {
      return;
    }
    const auto undefined = std::ranges::count_if(y, [](double value) { return !std::isfinite(value); });
    json_.begin_object().entry("name", name).entry("group", "output").entry("initial", 0.0).entry("count", y.size());
    json_.entry("undefined", static_cast<std::size_t>(undefined));
    const std::vector<std::size_t> kept = envelope_within(y, points_ == no_limit ? y.size() : points_);
    json_.key("x");
    write_f64(json_, pick(t, kept));
    json_.key("y");
    write_f32(json_, pick(y, kept));
    json_.end_object();
  }
  void write(std::string_view name, std::string_view group, Axis axis, const std::string& path, std::vector<double> y,
             double initial) {
    if (y.empty()) {
      return;
    }
    const auto number = static_cast<std::size_t>(axis);
    if (y.size() != times_[number].size()) {
      throw record::Error(source_.reader.file(), fmt::format("{} has {} values, and there are {} {}", path, y.size(),
                                                             times_[number].size(), axis_names[number]));
    }
    std::vector<double> own_times;  // of a curve with values at some of these places only
    if (path.starts_with("/laws/") && !with_laws_[0].empty()) {
      own_times = pick(times_[number], with_laws_[number]);
      y = pick(y, with_laws_[number]);
      if (y.empty()) {
        return;
      }
    }
    const auto undefined = std::ranges::count_if(y, [](double value) { return !std::isfinite(value); });
    json_.begin_object().entry("name", name).entry("group", group).entry("initial", initial).entry("count", y.size());
    json_.entry("undefined", static_cast<std::size_t>(undefined));
    if (const auto level = source_.notes.rounding.find(path); level != source_.notes.rounding.end()) {
      json_.entry("rounding", level->second);
    }
    if (points_ == no_limit && own_times.empty()) {
      json_.entry("axis", axis_names[number]);
      json_.key("y");
      write_f32(json_, y);
    } else {
      const std::vector<std::size_t> kept = envelope_within(y, points_);
      json_.key("x");
      write_f64(json_, pick(own_times.empty() ? times_[number] : own_times, kept));
      json_.key("y");
      write_f32(json_, pick(y, kept));
    }
    json_.end_object();
  }

  /// The times of the curves that have all their values.
  void write_times() {
    json_.key("times").begin_object();
    for (std::size_t i = 0; points_ == no_limit && i < axis_names.size(); ++i) {
      json_.key(axis_names[i]);
      write_f64(json_, times_[i]);
    }
    json_.end_object();
  }

private:
  Json& json_;
  const Source& source_;
  std::size_t points_;
  std::array<std::vector<double>, 3> times_;
  std::array<std::vector<std::size_t>, 2> with_laws_;  ///< levels, and steps, where laws were taken, if not at all
};

/// Of an orbit: what differs from each exact solution, computed here in double precision.
void write_errors(CurveWriter& curves, const Source& source) {
  const std::vector<StateColumn> columns = state_columns(source.contents);
  const std::size_t rows = source.reader.rows("/states/t");
  for (const std::string& name : source.contents.exact) {
    const auto own = std::ranges::find_if(
        columns, [&](const StateColumn& column) { return column.name == name && column.group != "exact"; });
    if (own == columns.end()) {
      continue;
    }
    const std::vector<double> state = read_rows(source.reader, own->path, rows, own->offset);
    std::vector<double> error = read_rows(source.reader, "/exact/" + name, rows, 0);
    const std::size_t stride = state.size() / rows;
    for (std::size_t k = 0; k < error.size(); ++k) {
      error[k] = state[k * stride + own->offset] - error[k];
    }
    curves.write(name, "error", Axis::states, "/exact/" + name, std::move(error), 0.0);
  }
}

}  // namespace

std::vector<double> level_times(const record::Reader& reader) {
  const std::string physical(figures::level_times);
  return reader.read(reader.has(physical) ? physical : "/levels/t");
}

std::vector<double> state_times(const record::Reader& reader) {
  std::vector<double> t = reader.read("/states/t");
  if (!reader.has(std::string(figures::level_times))) {
    return t;
  }
  const std::vector<double> q = read_rows(reader, "/states/q", t.size(), 0);
  const std::size_t stride = q.size() / t.size();
  for (std::size_t row = 0; row < t.size(); ++row) {
    t[row] = q[row * stride + stride - 1];  // the physical time is the last coordinate
  }
  return t;
}

std::size_t count_curves(const Contents& contents) {
  constexpr std::size_t always = 6;
  return always + contents.quantities.size() + contents.invariants.size() + contents.totals.size() +
         2 * contents.residuals.size() + (contents.kind == Contents::Kind::orbit ? contents.exact.size() : 0);
}

void write_curves(Json& json, const Source& source, const Resolution& resolution) {
  const Contents& contents = source.contents;
  const figures::Statistics& summary = source.summary;
  CurveWriter curves(json, source, resolution);
  json.key("curves").begin_array();
  curves.deviations("discrete energy", "energy", Axis::steps, "/levels/energy", summary.energy());
  curves.deviations("node energy", "energy", Axis::levels, "/levels/node_energy", summary.node_energy.initial);
  curves.values("h", "h", Axis::steps, "/levels/h");
  curves.values("gamma", "gamma", Axis::levels, "/levels/gamma");
  curves.values("step condition", "condition", Axis::steps, "/levels/step_condition");
  curves.values("iterations", "iterations", Axis::steps, "/levels/iterations");
  for (const std::string& name : contents.invariants) {
    curves.deviations(name, "invariant", Axis::levels, "/laws/" + name);
  }
  for (const std::string& name : contents.totals) {
    curves.deviations(name, "total", Axis::levels, "/laws/totals/" + name);
  }
  for (const std::string& name : contents.residuals) {
    curves.values(name + " max", "residual", Axis::steps, "/laws/" + name + "_max");
    curves.values(name + " rms", "residual", Axis::steps, "/laws/" + name + "_rms");
  }
  for (const std::string& name : contents.quantities) {
    curves.at_output_times(name, "/output/quantities/" + name);
  }
  if (contents.kind == Contents::Kind::orbit) {
    write_errors(curves, source);
  }
  json.end_array();
  curves.write_times();
  json.key("level_rows").begin_object().entry("rows", source.reader.rows("/levels/t"));
  json.entry("levels", summary.steps + 1).end_object();
}

std::vector<std::pair<double, double>> off_law_spans(const record::Reader& reader) {
  const std::vector<std::pair<double, double>> steps = steps_of(reader);
  const std::vector<double> flags =
      reader.has(record::off_law_path(reader)) ? reader.read(record::off_law_path(reader)) : std::vector<double>();
  std::vector<std::pair<double, double>> spans;
  for (std::size_t k = 0; k < std::min(flags.size(), steps.size()); ++k) {
    if (flags[k] == 0.0) {
      continue;
    }
    if (!spans.empty() && spans.back().second == steps[k].first) {
      spans.back().second = steps[k].second;
    } else {
      spans.push_back(steps[k]);
    }
  }
  return spans;
}

void write_off_law(Json& json, const record::Reader& reader, const Resolution& resolution) {
  const std::vector<std::pair<double, double>> spans = off_law_spans(reader);
  // More marks than there is room for are joined with their neighbours.
  const std::size_t joined = spans.empty() ? 1 : (spans.size() - 1) / resolution.off_law + 1;
  std::vector<double> from, to;
  for (std::size_t i = 0; i < spans.size(); i += joined) {
    from.push_back(spans[i].first);
    to.push_back(spans[std::min(i + joined, spans.size()) - 1].second);
  }
  json.entry("off_law_count", spans.size()).key("off_law").begin_object().key("from");
  write_f64(json, from);
  json.key("to");
  write_f64(json, to);
  json.end_object();
}

}  // namespace rubato::report
