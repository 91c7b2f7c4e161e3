#include <rubato/run/recorder.hpp>

#include <cmath>
#include <exception>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include <rubato/record/run_shape.hpp>

namespace rubato {

namespace {

/// The state of the VerdictMeter.
constexpr const char* meter_array = "verdict_meter";

template <typename Values>
const Values* array_of(const record::Checkpoint& checkpoint, const char* name) {
  const auto found = checkpoint.find(name);
  return found == checkpoint.end() ? nullptr : std::get_if<Values>(&found->second);
}

/// All but the state.
record::Checkpoint others_of(const ObservedRun& observed, const figures::Measures& measures) {
  record::Checkpoint checkpoint;
  if (const StepPotential& f = observed.simulation().step_potential(); f.active()) {
    checkpoint.emplace("step_potential", std::vector<double>{f.strength, f.length, f.exponent});
  }
  if (const std::optional<double> cost = observed.simulation().potential_cost()) {
    checkpoint.emplace("potential_price", std::vector<double>{*cost});
  }
  StateWriter meter;
  observed.meter().save(meter);
  checkpoint.emplace(meter_array, meter.values());
  checkpoint.emplace(figures::statistics_name, observed.statistics().values());
  checkpoint.emplace(figures::statistics_names_name, observed.statistics().names_text());
  checkpoint.emplace(figures::measures_name, figures::to_values(measures));
  checkpoint.emplace(record::state_version_name, std::vector<double>{record::state_version});
  return checkpoint;
}

}  // namespace

RowSink::InParts Recorder::in_parts(std::span<const record::Column> columns) {
  InParts wish{.wanted = InParts::Wanted::written, .file = {}, .rows = {}};
  std::vector<std::size_t> datasets;
  for (const record::Column column : columns) {
    datasets.push_back(column.number);
    wish.rows.push_back(writer_.rows(column.number));
  }
  const auto file = writer_.make_room(datasets);
  if (!file) {
    return {};
  }
  wish.file = *file;
  return wish;
}

std::optional<double> expected_record_bytes(const ObservedRun& observed) {
  const auto rows = record::expected_bytes(observed.layout());
  return rows ? std::optional(*rows + static_cast<double>(size_of_state(observed) * sizeof(double))) : std::nullopt;
}

std::size_t size_of_state(const ObservedRun& observed) {
  StateWriter count(StateWriter::For::going_back, nullptr);
  observed.save(count);
  return count.size();
}

record::CheckpointInParts make_checkpoint(const ObservedRun& observed, std::function<void()> begin,
                                          std::function<figures::Measures()> measures) {
  const auto hand_over = [&observed, begin = std::move(begin)](const record::CheckpointInParts::Take& take) {
    std::exception_ptr thrown;  // other ranks are not left alone with what they send
    StateWriter state(StateWriter::For::record, [&](std::span<const double> part) {
      if (!thrown) {
        try {
          take(part);
        } catch (...) {
          thrown = std::current_exception();
        }
      }
    });
    begin();
    observed.save(state);
    if (thrown) {
      std::rethrow_exception(thrown);
    }
  };
  return {.name = "state",
          .size = size_of_state(observed),
          .hand_over = hand_over,
          .others = [&observed, measures = std::move(measures)] { return others_of(observed, measures()); }};
}

bool restore(const record::Checkpoint& checkpoint, ObservedRun& observed) {
  const auto* values = array_of<std::vector<double>>(checkpoint, "state");
  if (values == nullptr) {
    return false;
  }
  StateReader state{std::span<const double>(*values)};
  return restore(checkpoint, state, observed);
}

bool restore(const record::Checkpoint& others, StateReader& state, ObservedRun& observed) {
  try {
    observed.restore(state);
    if (!state.done()) {
      return false;
    }
    if (const auto* values = array_of<std::vector<double>>(others, meter_array)) {
      StateReader meter{std::span<const double>(*values)};
      observed.meter().restore(meter);
    }
  } catch (const std::invalid_argument&) {
    return false;  // shorter than what it should restore
  }
  if (const auto* cost = array_of<std::vector<double>>(others, "potential_price");
      cost != nullptr && cost->size() == 1) {
    observed.simulation().integrator().levels().set_potential_cost(cost->front());
  }
  return true;
}

}  // namespace rubato
