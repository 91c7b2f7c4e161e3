#include <rubato/run/disagreements.hpp>

#include <fmt/format.h>

namespace rubato {

void Disagreements::add(Disagreement disagreement) {
  ++disagreements_;
  if (disagreement.row && !disagreement.index && std::isfinite(disagreement.recomputed)) {
    corrections_[disagreement.dataset][*disagreement.row] = disagreement.recomputed;
  }
  if (listed_of_[disagreement.dataset]++ < most_listed) {
    listed_.push_back(std::move(disagreement));
  }
}

void Disagreements::add_unlisted(const std::string& dataset, std::size_t count) {
  disagreements_ += count;
  listed_of_[dataset] += count;
}

std::string to_string(const Disagreement& disagreement) {
  std::string text = disagreement.dataset;
  if (disagreement.row) {
    text += fmt::format(", row {}", *disagreement.row);
  }
  if (disagreement.index) {
    text += fmt::format(", number {}", *disagreement.index);
  }
  const auto number = [](double value) { return std::isfinite(value) ? fmt::format("{:.17g}", value) : "no number"; };
  if (std::isfinite(disagreement.stored) || std::isfinite(disagreement.recomputed)) {
    text += fmt::format(": {} is stored, {} expected", number(disagreement.stored), number(disagreement.recomputed));
    if (disagreement.tolerance > 0.0) {
      text += fmt::format(" within {:.2g}", disagreement.tolerance);
    }
  }
  return text + fmt::format(" ({})", disagreement.reason);
}

}  // namespace rubato
