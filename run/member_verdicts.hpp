#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/figures/text.hpp>
#include <rubato/figures/verdict.hpp>

namespace rubato {

/// How a run ended: at its end, by a failure before that, or as it was told to.
enum class RunEnd { complete, failed, interrupted };

/// The warnings and verdicts of many runs, gathered: the members of an ensemble, or the runs of `converge`. Warnings
/// that differ in their numbers only are one.
class MemberVerdicts {
public:
  /// A run in the order of their numbers. \param label how a person recognises it; empty: by its number \param end the
  /// verdict of a run that was interrupted does not count
  void add(std::size_t number, const std::string& label, const std::vector<std::string>& warnings,
           const figures::Judgement& judgement, RunEnd end);
  /// A warning of a run that was added before.
  void add_warning(const std::string& which, const std::string& sentence);
  /// A doubt that a run gives rise to beside others. \param before its verdict without that
  void doubt(const std::string& which, const figures::Reason& reason, figures::Verdict before);
  /// A run whose warnings and reasons restore() has brought already.
  void add_verdict(figures::Verdict verdict, RunEnd end);

  /// The worst verdict; good if there is none.
  [[nodiscard]] figures::Verdict verdict() const;
  /// True if some reached their end, and the results of all of these are lost.
  [[nodiscard]] bool all_lost() const;
  /// "in 97 of 100 members, the first: 0: …".
  [[nodiscard]] std::vector<std::string> warnings(std::string_view plural) const;
  /// "lost: 3 of 100 members; …" in one line.
  [[nodiscard]] std::string verdict_text(std::string_view plural) const;
  /// verdict, verdicts, reasons and warnings.
  void add_to(figures::JsonObject& object, std::string_view plural) const;

  /// All but the verdicts, as text for a checkpoint.
  [[nodiscard]] std::string saved() const;
  void restore(std::string_view text);

private:
  void add_reason(const std::string& which, const figures::Reason& reason);

  struct Warning {
    std::string kind;  ///< the sentence without its numbers
    std::size_t members = 0;
    std::string first, sentence;  ///< of the first of them
  };
  struct Cause {
    figures::Reason worst;
    std::size_t members = 0;
    std::string which;  ///< has it
  };

  std::vector<Warning> warnings_;
  std::vector<Cause> causes_;
  std::array<std::size_t, 3> verdicts_{};
  std::size_t complete_ = 0, complete_lost_ = 0;  ///< of them
  std::size_t runs_ = 0;
};

}  // namespace rubato
