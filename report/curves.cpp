#include <algorithm>

#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

/// Writes curves over the time of the levels, or of the middle of the steps.
class CurveWriter {
public:
  CurveWriter(Json& json, const record::Reader& reader, const Resolution& resolution)
      : json_(json), reader_(reader), buckets_(resolution.curve_buckets), levels_(reader.read("/levels/t")) {
    for (std::size_t k = 0; k + 1 < levels_.size(); ++k) {
      steps_.push_back(levels_[k] + (levels_[k + 1] - levels_[k]) / 2);
    }
  }

  void levels(std::string_view name, std::string_view group, const std::string& path, bool from_first = false) {
    write(name, group, path, from_first, levels_);
  }
  void steps(std::string_view name, std::string_view group, const std::string& path, bool from_first = false) {
    if (!steps_.empty()) {
      write(name, group, path, from_first, steps_);
    }
  }

private:
  void write(std::string_view name, std::string_view group, const std::string& path, bool from_first,
             std::span<const double> t) {
    std::vector<double> y = reader_.read(path);
    const double initial = from_first ? y.front() : 0.0;
    std::ranges::for_each(y, [initial](double& value) { value -= initial; });
    const std::vector<std::size_t> kept = envelope(y, buckets_);
    json_.begin_object().entry("name", name).entry("group", group).entry("initial", initial).entry("count", y.size());
    json_.key("x");
    write_f64(json_, pick(t, kept));
    json_.key("y");
    write_f32(json_, pick(y, kept));
    json_.end_object();
  }

  Json& json_;
  const record::Reader& reader_;
  std::size_t buckets_;
  std::vector<double> levels_, steps_;
};

}  // namespace

std::size_t count_curves(const Contents& contents) {
  constexpr std::size_t always = 6;
  return always + contents.invariants.size() + contents.totals.size() + 2 * contents.residuals.size();
}

void write_curves(Json& json, const record::Reader& reader, const Contents& contents, const Resolution& resolution) {
  CurveWriter curves(json, reader, resolution);
  json.key("curves").begin_array();
  curves.steps("discrete energy", "energy", "/levels/energy", true);
  curves.levels("node energy", "energy", "/levels/node_energy", true);
  curves.steps("h", "h", "/levels/h");
  curves.levels("gamma", "gamma", "/levels/gamma");
  curves.steps("step condition", "condition", "/levels/step_condition");
  curves.steps("iterations", "iterations", "/levels/iterations");
  for (const std::string& name : contents.invariants) {
    curves.levels(name, "invariant", "/laws/" + name, true);
  }
  for (const std::string& name : contents.totals) {
    curves.levels(name, "total", "/laws/totals/" + name, true);
  }
  for (const std::string& name : contents.residuals) {
    curves.steps(name + " max", "residual", "/laws/" + name + "_max");
    curves.steps(name + " rms", "residual", "/laws/" + name + "_rms");
  }
  json.end_array();
}

void write_bridges(Json& json, const record::Reader& reader) {
  // More marks than a picture can show are joined with their neighbours.
  constexpr std::size_t most = 2000;
  const std::vector<double> t = reader.read("/levels/t");
  const std::vector<double> bridged =
      reader.has("/levels/bridged") ? reader.read("/levels/bridged") : std::vector<double>();
  std::vector<std::pair<double, double>> spans;
  for (std::size_t k = 0; k < bridged.size(); ++k) {
    if (bridged[k] == 0.0) {
      continue;
    }
    if (k > 0 && bridged[k - 1] != 0.0) {
      spans.back().second = t[k + 1];
    } else {
      spans.emplace_back(t[k], t[k + 1]);
    }
  }
  const std::size_t joined = spans.size() / most + 1;
  json.entry("bridge_count", spans.size()).key("bridges").begin_array();
  for (std::size_t i = 0; i < spans.size(); i += joined) {
    json.begin_array().value(spans[i].first).value(spans[std::min(i + joined, spans.size()) - 1].second).end_array();
  }
  json.end_array();
}

}  // namespace rubato::report
