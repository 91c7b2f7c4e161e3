#include <rubato/run/conclusion.hpp>

#include <fmt/format.h>

namespace rubato {

void conclude(const record::Reader& reader, Disagreements& findings, Outcome& outcome) {
  for (const std::string& name : reader.altered()) {
    if (!findings.has(name)) {
      findings.add({.dataset = name.front() == '/' ? name : "attribute " + name,
                    .reason = "it is not what was written, by its checksum in the record"});
    }
  }
  outcome.compared = findings.compared();
  outcome.disagreement_count = findings.disagreements();
  outcome.disagreements = findings.listed();
  if (findings.disagreements() > 0) {
    outcome.status = ExitStatus::contradiction;
    outcome.message =
        fmt::format("{} contradicts itself: of {} numbers that were recomputed {} disagree; the first: {}",
                    outcome.file, findings.compared(), findings.disagreements(), to_string(findings.listed().front()));
  }
}

}  // namespace rubato
