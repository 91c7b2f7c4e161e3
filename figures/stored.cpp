#include <rubato/figures/stored.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/record/run_shape.hpp>

namespace rubato::figures {

namespace {

const std::string checkpoint_group = "/checkpoint/";
const std::string statistics_path = checkpoint_group + std::string(statistics_name);

/// Values of one dataset in memory: many rows of a small grid, so that no chunk is read again and again.
constexpr std::size_t values_at_once = std::size_t{1} << 18;

/// One number for each level or step, as stored or as corrected.
class Column {
public:
  Column(const record::Reader& reader, const std::string& path, std::size_t rows, const Corrections& corrections)
      : values_(reader, path) {
    if (values_.rows() != rows) {
      throw record::Error(reader.file(),
                          fmt::format("{} has {} rows; the record's levels need {}", path, values_.rows(), rows));
    }
    if (const auto found = corrections.find(path); found != corrections.end()) {
      corrections_ = &found->second;
    }
  }
  [[nodiscard]] double at(std::size_t row) {
    if (corrections_ != nullptr) {
      if (const auto found = corrections_->find(row); found != corrections_->end()) {
        return found->second;
      }
    }
    return values_.at(row);
  }

private:
  StoredRows values_;
  const std::map<std::size_t, double>* corrections_ = nullptr;
};

class Reading {
public:
  Reading(const record::Reader& reader, const Names& names, const Corrections& corrections)
      : reader_(reader), names_(names), corrections_(corrections), levels_(reader.rows("/levels/t")) {}

  Statistics of_rows() {
    if (levels_ == 0) {
      throw record::Error(reader_.file(), "it has no level");
    }
    std::vector<std::string> vectors;
    while (reader_.has(growth_path(fmt::format("{}", vectors.size() + 1)))) {
      vectors.push_back(fmt::format("{}", vectors.size() + 1));
    }
    statistics_.name(names_.invariants, names_.totals, names_.residuals, names_.events, vectors);
    find_levels_of_laws();
    add_levels();
    if (levels_ > 1 || reader_.has("/levels/h")) {
      add_steps();
      add_residuals();
      add_tangents();
    }
    add_events();
    add_others();
    return std::move(statistics_);
  }

  /// Nothing if it has none.
  std::optional<Statistics> of_checkpoint() {
    if (!reader_.has(statistics_path)) {
      return std::nullopt;
    }
    try {
      std::string names;
      for (const std::int64_t character :
           reader_.read_integers(checkpoint_group + std::string(statistics_names_name))) {
        names += static_cast<char>(character);
      }
      statistics_ = Statistics::of(reader_.read(statistics_path), names);
      take(statistics_.invariants, names_.invariants);
      take(statistics_.totals, names_.totals);
      take(statistics_.residuals, names_.residuals);
      take(statistics_.events, names_.events);
    } catch (const std::invalid_argument& error) {
      throw record::Error(reader_.file(), fmt::format("{}: {}", statistics_path, error.what()));
    }
    add_others();
    return std::move(statistics_);
  }

private:
  /// Leaves those of a list that are wanted, in their order.
  template <typename T>
  static void take(std::vector<Named<T>>& list, const std::vector<std::string>& wanted) {
    std::vector<Named<T>> taken;
    for (const std::string& name : wanted) {
      const auto found = std::ranges::find(list, name, &Named<T>::name);
      if (found == list.end()) {
        throw std::invalid_argument(fmt::format("there is nothing of '{}'", name));
      }
      taken.push_back(*found);
    }
    list = std::move(taken);
  }

  /// What no row and no sum reports on.
  void add_others() {
    if (reader_.has("/states/momentum")) {
      const std::vector<std::string> momenta = reader_.read_strings("/states/momentum");
      statistics_.balance = !momenta.empty() && momenta.back() == work_momentum;
    } else {  // a lattice, whose fields have datasets of their own
      statistics_.balance = reader_.has(fmt::format("/states/{}", work_momentum));
    }
    read_potential();
    if (const std::string times(level_times); reader_.has(times)) {
      statistics_.clock_start = reader_.read(times, 0, 1).at(0);
      statistics_.clock = reader_.read(times, reader_.rows(times) - 1, 1).at(0);
    }
    add_errors();
    if (const std::string path(measures_path); reader_.has(path)) {
      statistics_.measures = measures_of(reader_.read(path));
    }
  }

  Column column(const std::string& path, std::size_t rows) { return {reader_, path, rows, corrections_}; }
  std::optional<Column> optional_column(const std::string& path, std::size_t rows) {
    return reader_.has(path) ? std::optional(column(path, rows)) : std::nullopt;
  }
  [[nodiscard]] std::size_t steps() const { return levels_ - 1; }

  void find_levels_of_laws() {
    if (!reader_.has(std::string(laws_taken))) {
      return;
    }
    Column flags = column(std::string(laws_taken), levels_);
    for (std::size_t k = 0; k < levels_; ++k) {
      taken_.push_back(flags.at(k) != 0.0);
    }
    const auto second = std::find(taken_.begin() + 1, taken_.end(), true);
    statistics_.laws_every = static_cast<std::size_t>(second - taken_.begin());
  }
  [[nodiscard]] bool taken_at(std::size_t level) const { return taken_.empty() || taken_[level]; }

  void add_levels() {
    Column t = column("/levels/t", levels_), gamma = column("/levels/gamma", levels_),
           energy = column("/levels/node_energy", levels_);
    std::vector<Column> invariants, totals;
    for (const std::string& name : names_.invariants) {
      invariants.push_back(column("/laws/" + name, levels_));
    }
    for (const std::string& name : names_.totals) {
      totals.push_back(column("/laws/totals/" + name, levels_));
    }
    std::vector<double> invariant_values(invariants.size()), total_values(totals.size());
    for (std::size_t k = 0; k < levels_; ++k) {
      statistics_.add_level({.t = t.at(k), .node_energy = energy.at(k), .gamma = gamma.at(k)});
      std::ranges::transform(totals, total_values.begin(), [k](Column& column) { return column.at(k); });
      if (!taken_at(k)) {
        statistics_.add_balances(total_values);
        continue;
      }
      std::ranges::transform(invariants, invariant_values.begin(), [k](Column& column) { return column.at(k); });
      statistics_.add_laws(invariant_values, total_values);
    }
  }

  void add_steps() {
    Column h = column("/levels/h", steps()), energy = column("/levels/energy", steps()),
           off_law = column(record::off_law_path(reader_), steps()),
           condition = column("/levels/step_condition", steps()), iterations = column("/levels/iterations", steps());
    std::optional<Column> target = optional_column("/levels/target", steps()),
                          rounding = optional_column("/levels/rounding", steps()),
                          potential = optional_column("/levels/step_potential", steps());
    for (std::size_t k = 0; k < steps(); ++k) {
      StepFigures step{.h = h.at(k),
                       .energy = energy.at(k),
                       .condition = condition.at(k),
                       .iterations = iterations.at(k),
                       .off_law = off_law.at(k) != 0.0};
      step.rounding = rounding ? rounding->at(k) : 0.0;
      step.potential = potential ? potential->at(k) : 0.0;
      if (target) {
        step.target = target->at(k);
      } else if (statistics_.has_law()) {
        step.target = statistics_.energy();
      }
      statistics_.add_step(step);
    }
  }

  void read_potential() {
    const std::string path(step_potential_path);
    if (!reader_.has(path)) {
      return;
    }
    const std::vector<double> numbers = reader_.read(path);
    if (numbers.size() != 3) {
      throw record::Error(reader_.file(), path + " has to be the strength, the length and the exponent of f'");
    }
    statistics_.potential_length = numbers[1];
    statistics_.potential_exponent = numbers[2];
  }

  void add_residuals() {
    const auto cells = static_cast<double>(stored_cells(reader_));
    for (std::size_t i = 0; i < names_.residuals.size(); ++i) {
      const std::string path = "/laws/" + names_.residuals[i];
      Column max = column(path + "_max", steps()), rms = column(path + "_rms", steps());
      std::optional<Column> undefined = optional_column(path + "_undefined", steps());
      for (std::size_t k = 0; k < steps(); ++k) {
        if (!taken_at(k + 1)) {
          continue;
        }
        ResidualFigures figures{.max = max.at(k), .rms = rms.at(k)};
        figures.undefined = undefined ? undefined->at(k) : 0.0;
        figures.defined = std::isnan(figures.rms) ? 0.0 : cells - figures.undefined;
        statistics_.add_residual(i, figures);
      }
    }
  }

  void add_tangents() {
    std::vector<Column> growth;
    for (const auto& [name, value] : statistics_.growth) {
      growth.push_back(column(growth_path(name), steps()));
    }
    if (growth.empty()) {
      return;
    }
    std::optional<Column> defect = optional_column(std::string(two_form_path), steps());
    std::optional<Column> times = optional_column(std::string(level_times), levels_);
    Column h = column("/levels/h", steps());
    std::vector<double> logarithms(growth.size());
    for (std::size_t k = 0; k < steps(); ++k) {
      std::ranges::transform(growth, logarithms.begin(), [k](Column& column) { return column.at(k); });
      const double begin = times ? times->at(k) : 0.0;
      statistics_.add_tangents(times ? times->at(k + 1) - begin : h.at(k), logarithms, defect ? defect->at(k) : 0.0);
    }
  }

  void add_events() {
    for (auto& [name, event] : statistics_.events) {
      const std::string group = "/events/" + name;
      const std::size_t rows = reader_.rows(group + "/t");
      Column t = column(group + "/t", rows);
      std::optional<Column> stops = optional_column(group + "/stops", rows);
      std::optional<StoredRows> quantities;
      if (const std::string path = group + "/quantities"; reader_.has(path)) {
        quantities.emplace(reader_, path, reader_.info(path).row_size());
      }
      for (std::size_t row = 0; row < rows; ++row) {
        const bool defined = !quantities || all_finite(quantities->row(row));
        event.add(t.at(row), stops && stops->at(row) != 0.0, defined);
      }
      Column missed = column(group + "/missed", steps());
      for (std::size_t k = 0; k < steps(); ++k) {
        event.add_step(static_cast<int>(missed.at(k)));
      }
    }
  }

  void add_errors() {
    const std::size_t last = reader_.rows("/states/t") - 1;
    for (const std::string& name : names_.exact) {
      const std::vector<double> state = state_of(name, last);
      const std::vector<double> exact = reader_.read("/exact/" + name, last, 1);
      if (state.size() != exact.size()) {
        continue;
      }
      Named<Spread> error{name, {}};
      for (std::size_t i = 0; i < state.size(); ++i) {
        error.value.add(std::abs(state[i] - exact[i]));
      }
      statistics_.errors.push_back(error);
    }
  }

  /// A row of a coordinate, a momentum, a velocity or a field.
  [[nodiscard]] std::vector<double> state_of(const std::string& name, std::size_t row) const {
    for (const auto& [scale, path] : {std::pair("/states/coordinate", "/states/q"),
                                      {"/states/momentum", "/states/p"},
                                      {"/states/velocity", "/states/q_dot"}}) {
      if (!reader_.has(scale)) {
        continue;
      }
      const std::vector<std::string> names = reader_.read_strings(scale);
      if (const auto found = std::ranges::find(names, name); found != names.end()) {
        return {reader_.read(path, row, 1).at(static_cast<std::size_t>(found - names.begin()))};
      }
    }
    return reader_.has("/states/" + name) ? reader_.read("/states/" + name, row, 1) : std::vector<double>();
  }

  const record::Reader& reader_;
  const Names& names_;
  const Corrections& corrections_;
  std::size_t levels_;
  std::vector<bool> taken_;  ///< of every level, where not all were
  Statistics statistics_;
};

}  // namespace

StoredRows::StoredRows(const record::Reader& reader, std::string path, std::size_t row_size)
    : reader_(&reader), path_(std::move(path)), row_size_(row_size) {
  if (!reader.has(path_)) {
    throw Mismatch(reader.file(), path_, fmt::format("there is no dataset {}", path_));
  }
  const record::DatasetInfo info = reader.info(path_);
  if (info.is_text || info.shape.empty() || info.row_size() != row_size) {
    throw Mismatch(reader.file(), path_,
                   fmt::format("a row of {} has {} values; by the problem it should have {}", path_,
                               info.is_text || info.shape.empty() ? 0 : info.row_size(), row_size));
  }
  rows_ = info.shape.front();
  block_ = std::max<std::size_t>(1, values_at_once / std::max<std::size_t>(1, row_size));
}

std::span<const double> StoredRows::row(std::size_t row) {
  if (row < first_ || row >= first_ + values_.size() / row_size_) {
    first_ = row - row % block_;
    values_ = reader_->read(path_, first_, std::min(block_, rows_ - std::min(rows_, first_)));
  }
  return std::span<const double>(values_).subspan((row - first_) * row_size_, row_size_);
}

std::size_t stored_cells(const record::Reader& reader) {
  std::size_t cells = 1;
  for (const char* axis : {"/grid/x", "/grid/y", "/grid/z"}) {
    cells *= reader.has(axis) ? reader.rows(axis) : 1;
  }
  return cells;
}

Statistics statistics_of_rows(const record::Reader& reader, const Names& names, const Corrections& corrections) {
  return Reading(reader, names, corrections).of_rows();
}

Statistics stored_statistics(const record::Reader& reader, const Names& names) {
  const Corrections none;
  if (auto statistics = Reading(reader, names, none).of_checkpoint()) {
    return *std::move(statistics);
  }
  return statistics_of_rows(reader, names);
}

std::optional<std::size_t> stored_last_level(const record::Reader& reader) {
  if (!reader.has(statistics_path)) {
    return std::nullopt;
  }
  const std::vector<double> steps = reader.rows(statistics_path) > Statistics::place_of_steps
                                        ? reader.read(statistics_path, Statistics::place_of_steps, 1)
                                        : std::vector<double>();
  constexpr double most = 0x1p53;
  if (steps.empty() || !(steps.front() >= 0.0 && steps.front() < most) || steps.front() != std::floor(steps.front())) {
    throw Mismatch(reader.file(), statistics_path, fmt::format("{} has no number of steps", statistics_path));
  }
  return static_cast<std::size_t>(steps.front());
}

}  // namespace rubato::figures
