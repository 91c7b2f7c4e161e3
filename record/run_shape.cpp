#include <rubato/record/run_shape.hpp>

#include <array>
#include <map>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include <rubato/record/error.hpp>

namespace rubato::record {

namespace {

struct Required {
  std::string_view path;
  Type type;
  bool per_step;
};

constexpr const char* flags = "/levels/off_law";
constexpr const char* earlier_flags = "/levels/bridged";

constexpr std::array<Required, 7> required{{
    {"/levels/gamma", Type::f64, false},
    {"/levels/node_energy", Type::f64, false},
    {"/levels/step", Type::i64, true},
    {"/levels/h", Type::f64, true},
    {"/levels/energy", Type::f64, true},
    {"/levels/iterations", Type::i32, true},
    {"/levels/step_condition", Type::f64, true},
}};

class Shapes {
public:
  explicit Shapes(const Reader& reader) : file_(reader.file()) {
    for (DatasetInfo& info : reader.datasets()) {
      all_.emplace(info.path, std::move(info));
    }
    levels_ = rows_of("/levels/t", Type::f64);
    stored_ = rows_of("/states/t", Type::f64);
  }

  void require() const {
    for (const Required& one : required) {
      require_rows(std::string(one.path), rows_of(std::string(one.path), one.type), one.per_step);
    }
    const std::string off_law = all_.contains(earlier_flags) ? earlier_flags : flags;
    require_rows(off_law, rows_of(off_law, Type::u8), true);
    if (const std::size_t rows = rows_of("/states/level", Type::i64); rows != stored_) {
      refuse("/states/level", fmt::format("has {} rows, and {} levels are stored", rows, stored_));
    }
    for (const auto& [path, info] : all_) {
      if (info.grows) {
        require_growing(info);
      }
    }
    if (is_orbit()) {
      require_names("/states/coordinate");
      require_names("/states/momentum");
      require_dimensions("/states/q", {"t", "coordinate"});
      require_dimensions("/states/p", {"t", "momentum"});
      if (all_.contains("/states/velocity")) {  // of a problem stated by L
        require_names("/states/velocity");
        require_dimensions("/states/q_dot", {"t", "velocity"});
      }
    }
  }

private:
  [[noreturn]] void refuse(const std::string& path, const std::string& reason) const {
    throw Error(file_, fmt::format("dataset '{}' {}", path, reason));
  }

  [[nodiscard]] const DatasetInfo& at(const std::string& path) const {
    const auto found = all_.find(path);
    if (found == all_.end()) {
      throw Error(file_, fmt::format("there is no dataset '{}'", path));
    }
    return found->second;
  }

  [[nodiscard]] std::size_t rows_of(const std::string& path, Type type) const {
    const DatasetInfo& info = at(path);
    if (info.is_text || info.type != type || info.shape.size() != 1 || !info.grows) {
      refuse(path, "is not a growing list of numbers of its type");
    }
    if (info.shape.front() == 0 && path.ends_with("/t")) {
      refuse(path, "is empty");
    }
    return info.shape.front();
  }

  void require_rows(const std::string& path, std::size_t rows, bool per_step) const {
    const std::size_t expected = levels_ - (per_step ? 1 : 0);
    if (rows != expected) {
      refuse(path, fmt::format("has {} rows, and {} levels need {}", rows, levels_, expected));
    }
  }

  void require_growing(const DatasetInfo& info) const {
    const std::string group = info.path.substr(0, info.path.rfind('/'));
    const std::string& axis = info.dimensions.front();
    if (info.is_text) {
      refuse(info.path, "does not hold numbers");
    }
    if (group == "/levels" || group == "/laws" || group == "/laws/totals") {
      if (info.shape.size() != 1 || (axis != "t" && axis != "step")) {
        refuse(info.path, "is not one number per level or step");
      }
      require_rows(info.path, info.shape.front(), axis == "step");
    } else if (group == "/output" || group.starts_with("/output/")) {
      if (const std::size_t rows = at("/output/t").shape.front(); info.shape.front() != rows) {
        refuse(info.path, fmt::format("has {} rows, and there are {} output times", info.shape.front(), rows));
      }
      for (std::size_t i = 1; i < info.shape.size(); ++i) {
        require_scale(info, i);
      }
    } else if (group.starts_with("/events/")) {
      require_event(info, group);
    } else if (group == "/laws/fields" || group == "/exact" || group == "/states" || group.starts_with("/states/")) {
      if (info.shape.front() != stored_) {
        refuse(info.path, fmt::format("has {} rows, and {} levels are stored", info.shape.front(), stored_));
      }
      for (std::size_t i = 1; i < info.shape.size(); ++i) {
        require_scale(info, i);
      }
      require_dimensions(info, group);
    }
  }

  /// Rows of crossings, but for what is reported on every step.
  void require_event(const DatasetInfo& info, const std::string& group) const {
    const std::string name = info.path.substr(group.size() + 1);
    if (name == "missed" || name == "step") {
      if (info.shape.size() != 1) {
        refuse(info.path, "is not one number per step");
      }
      require_rows(info.path, info.shape.front(), true);
      return;
    }
    const DatasetInfo& times = at(group + "/t");
    if (!times.grows || times.is_text || times.shape.size() != 1) {
      refuse(times.path, "is not a growing list of numbers");
    }
    if (info.shape.front() != times.shape.front()) {
      refuse(info.path,
             fmt::format("has {} rows, and there are {} crossings", info.shape.front(), times.shape.front()));
    }
    const std::string along = name == "q"            ? "coordinate"
                              : name == "p"          ? "momentum"
                              : name == "quantities" ? "quantity"
                                                     : "";
    if (info.shape.size() != (along.empty() ? 1U : 2U) || (!along.empty() && info.dimensions[1] != along)) {
      refuse(info.path, "does not have the shape of a dataset of crossings");
    }
    if (!along.empty()) {
      require_scale(info, 1);
    }
  }

  /// Every state has the shape of the others, and so have the residual fields, which may lie in cells.
  void require_dimensions(const DatasetInfo& info, const std::string& group) const {
    const std::string name = info.path.substr(group.size() + 1);
    if (is_orbit()) {
      const bool is_state = group != "/exact" && (name == "q" || name == "p" || name == "q_dot");
      if (info.shape.size() != (is_state ? 2 : 1)) {
        refuse(info.path, "does not have the shape of a state of an orbit");
      }
      return;
    }
    if (info.shape.size() == 1 && (name == "t" || name == "level")) {
      return;
    }
    const bool is_law = group == "/laws/fields";
    for (const auto& [path, other] : all_) {
      const std::string group_of_other = path.substr(0, path.rfind('/'));
      const bool is_field = other.grows && other.shape.size() > 1 && group_of_other == (is_law ? group : "/states");
      if (is_field && other.dimensions != info.dimensions) {
        refuse(info.path, fmt::format("does not lie along the same axes as '{}'", path));
      }
      if (is_field) {
        return;
      }
    }
    refuse(info.path, "is a field, and the record has no state that is one");
  }

  void require_dimensions(const std::string& path, const std::vector<std::string>& names) const {
    if (at(path).dimensions != names) {
      refuse(path, "has other dimensions than the states of an orbit");
    }
  }

  [[nodiscard]] bool is_orbit() const { return all_.contains("/states/coordinate"); }

  void require_scale(const DatasetInfo& info, std::size_t dimension) const {
    const std::string& name = info.dimensions[dimension];
    const bool of_orbit = name == "coordinate" || name == "momentum" || name == "velocity";
    const bool of_event = name == "quantity";
    const DatasetInfo& scale = at((of_event   ? info.path.substr(0, info.path.rfind('/') + 1)
                                   : of_orbit ? "/states/"
                                              : "/grid/") +
                                  name);
    if (scale.shape.size() != 1 || scale.shape.front() != info.shape[dimension]) {
      refuse(info.path, fmt::format("has {} values along '{}', which has {}", info.shape[dimension], scale.path,
                                    scale.shape.empty() ? 1 : scale.shape.front()));
    }
    if (scale.shape.front() == 0) {
      refuse(scale.path, "is empty");
    }
  }

  void require_names(const std::string& path) const {
    const DatasetInfo& info = at(path);
    if (!info.is_text || info.shape.size() != 1 || info.shape.front() == 0) {
      refuse(path, "is not a list of names");
    }
  }

  std::filesystem::path file_;
  std::map<std::string, DatasetInfo> all_;
  std::size_t levels_ = 0, stored_ = 0;
};

}  // namespace

void require_run(const Reader& reader) {
  if (reader.has("/members/number")) {
    throw Error(
        reader.file(),
        "it is the record of an ensemble, not of one run; `rubato check`, `resume`, `report` and `export` take it");
  }
  Shapes(reader).require();
  std::int64_t last = -1;
  for (const std::int64_t level : reader.read_integers("/states/level")) {
    if (level <= last || (last < 0 && level != 0)) {
      throw Error(reader.file(), fmt::format("dataset '/states/level' goes from level {} to level {}", last, level));
    }
    last = level;
  }
}

bool is_of_earlier_version(const Reader& reader) {
  if (reader.has("/members/number")) {
    return reader.has("/members/bridges/steps");
  }
  const std::string path = fmt::format("/checkpoint/{}", state_version_name);
  return !reader.has(path) || reader.read(path) != std::vector{state_version};
}

void refuse_earlier_version(const Reader& reader) {
  if (is_of_earlier_version(reader)) {
    throw Error(reader.file(),
                "an earlier version wrote it, and this one cannot continue its run: run its problem again");
  }
}

std::string off_law_path(const Reader& reader) {
  return reader.has(earlier_flags) ? earlier_flags : flags;
}

}  // namespace rubato::record
