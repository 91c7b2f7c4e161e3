#include <rubato/study/recorder.hpp>

#include <span>
#include <stdexcept>
#include <variant>

namespace rubato::study {

namespace {

template <typename Values>
const Values* array_of(const record::Checkpoint& checkpoint, const char* name) {
  const auto found = checkpoint.find(name);
  return found == checkpoint.end() ? nullptr : std::get_if<Values>(&found->second);
}

}  // namespace

record::Checkpoint make_checkpoint(const Chronicle& chronicle, const Digests& digests) {
  StateWriter state;
  chronicle.save(state);
  std::vector<std::int64_t> numbers;
  for (const Digest& digest : digests) {
    numbers.insert(numbers.end(), {digest.rows(), digest.value()});
  }
  Digest whole;
  whole.add_row(std::span<const double>(state.values()));
  numbers.insert(numbers.end(), {whole.rows(), whole.value()});
  record::Checkpoint checkpoint = {{"state", state.values()}, {"digests", std::move(numbers)}};
  if (const StepPotential& f = chronicle.simulation().step_potential(); f.active()) {
    checkpoint.emplace("step_potential", std::vector<double>{f.strength, f.length, f.exponent});
  }
  if (const std::optional<double> price = chronicle.simulation().potential_price()) {
    checkpoint.emplace("potential_price", std::vector<double>{*price});
  }
  return checkpoint;
}

std::optional<Digests> restored(const record::Checkpoint& checkpoint, Chronicle& chronicle) {
  const auto* values = array_of<std::vector<double>>(checkpoint, "state");
  const auto* numbers = array_of<std::vector<std::int64_t>>(checkpoint, "digests");
  if (values == nullptr || numbers == nullptr || numbers->size() != 2 * chronicle.layout().datasets.size() + 2) {
    return std::nullopt;
  }
  try {
    StateReader state{std::span<const double>(*values)};
    chronicle.restore(state);
    if (!state.done()) {
      return std::nullopt;
    }
  } catch (const std::invalid_argument&) {
    return std::nullopt;  // shorter than what it should restore
  }
  if (const auto* price = array_of<std::vector<double>>(checkpoint, "potential_price");
      price != nullptr && price->size() == 1) {
    chronicle.simulation().integrator().levels().tell_potential_price(price->front());
  }
  Digests digests;
  for (std::size_t i = 0; i + 2 < numbers->size(); i += 2) {
    digests.emplace_back((*numbers)[i], (*numbers)[i + 1]);
  }
  return digests;
}

}  // namespace rubato::study
