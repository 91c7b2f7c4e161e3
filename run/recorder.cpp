#include <rubato/run/recorder.hpp>

#include <exception>
#include <memory>
#include <span>
#include <stdexcept>
#include <utility>
#include <variant>

namespace rubato {

namespace {

template <typename Values>
const Values* array_of(const record::Checkpoint& checkpoint, const char* name) {
  const auto found = checkpoint.find(name);
  return found == checkpoint.end() ? nullptr : std::get_if<Values>(&found->second);
}

/// All but the state, which `whole` is the digest of.
record::Checkpoint others_of(const Chronicle& chronicle, const Digests& digests, const Digest& whole) {
  std::vector<std::int64_t> numbers;
  for (const Digest& digest : digests) {
    numbers.insert(numbers.end(), {digest.rows(), digest.value()});
  }
  numbers.insert(numbers.end(), {whole.rows(), whole.value()});
  record::Checkpoint checkpoint = {{Digest::array, std::move(numbers)}};
  if (const StepPotential& f = chronicle.simulation().step_potential(); f.active()) {
    checkpoint.emplace("step_potential", std::vector<double>{f.strength, f.length, f.exponent});
  }
  if (const std::optional<double> price = chronicle.simulation().potential_price()) {
    checkpoint.emplace("potential_price", std::vector<double>{*price});
  }
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

record::Checkpoint make_checkpoint(const Chronicle& chronicle, const Digests& digests) {
  StateWriter state;
  chronicle.save(state);
  Digest whole;
  whole.add_row(std::span<const double>(state.values()));
  record::Checkpoint checkpoint = others_of(chronicle, digests, whole);
  checkpoint.emplace("state", state.values());
  return checkpoint;
}

record::CheckpointInParts make_checkpoint_in_parts(const Chronicle& chronicle, const Digests& digests,
                                                   std::function<void()> begin) {
  StateWriter count(StateWriter::For::going_back, nullptr);
  chronicle.save(count);
  const auto whole = std::make_shared<Digest>();
  const auto hand_over = [&chronicle, whole, begin = std::move(begin)](const record::CheckpointInParts::Take& take) {
    std::exception_ptr thrown;  // other ranks are not left alone with what they send
    StateWriter state(StateWriter::For::record, [&](std::span<const double> part) {
      whole->add_part(part, false);
      if (!thrown) {
        try {
          take(part);
        } catch (...) {
          thrown = std::current_exception();
        }
      }
    });
    begin();
    chronicle.save(state);
    whole->add_part(std::span<const double>(), true);
    if (thrown) {
      std::rethrow_exception(thrown);
    }
  };
  return {.name = "state", .size = count.size(), .hand_over = hand_over, .others = [&chronicle, &digests, whole] {
            return others_of(chronicle, digests, *whole);
          }};
}

std::optional<Digests> restored(const record::Checkpoint& checkpoint, Chronicle& chronicle) {
  const auto* values = array_of<std::vector<double>>(checkpoint, "state");
  if (values == nullptr) {
    return std::nullopt;
  }
  StateReader state{std::span<const double>(*values)};
  return restored(checkpoint, state, chronicle);
}

std::optional<Digests> restored(const record::Checkpoint& others, StateReader& state, Chronicle& chronicle) {
  const auto* numbers = array_of<std::vector<std::int64_t>>(others, Digest::array);
  const bool fits = numbers != nullptr && numbers->size() == 2 * chronicle.layout().datasets.size() + 2;
  try {
    chronicle.restore(state);
    if (!state.done() || !fits) {
      return std::nullopt;
    }
  } catch (const std::invalid_argument&) {
    return std::nullopt;  // shorter than what it should restore
  }
  if (const auto* price = array_of<std::vector<double>>(others, "potential_price");
      price != nullptr && price->size() == 1) {
    chronicle.simulation().integrator().levels().tell_potential_price(price->front());
  }
  Digests digests;
  for (std::size_t i = 0; i + 2 < numbers->size(); i += 2) {
    digests.emplace_back((*numbers)[i], (*numbers)[i + 1]);
  }
  return digests;
}

}  // namespace rubato
