#pragma once

#include <atomic>
#include <exception>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/record/layout.hpp>
#include <rubato/run/run.hpp>

/// The runs of an ensemble's members, by the caller that takes them.
namespace rubato {

/// What the record of an ensemble keeps of one member.
struct MemberResult {
  ExitStatus status = ExitStatus::done;
  std::string message;
  std::vector<std::string> warnings;
  figures::Judgement judgement;
  std::vector<double> figures;              ///< one for each name asked for; NaN where the run has none
  std::vector<std::vector<double>> states;  ///< the last one, in the order of the layout
  std::vector<std::vector<double>> series;  ///< of each dataset that is kept whole all rows, likewise
};

/// What the record keeps whole of a run: the crossings of its events, and what is reported at output times.
[[nodiscard]] bool is_kept_whole(const record::Dataset& dataset);
/// What the record keeps of a state: of an orbit q and p, of a lattice its fields.
[[nodiscard]] bool is_last_state(const record::Dataset& dataset);

/// The figures that members of a problem may have, as a run shows them in JSON.
[[nodiscard]] std::vector<std::string> figure_names(const Problem& member);

/// Where members are handed out, and their results handed in. Calls may come from any thread.
class MemberDesk {
public:
  MemberDesk() = default;
  MemberDesk(const MemberDesk&) = delete;
  MemberDesk& operator=(const MemberDesk&) = delete;
  virtual ~MemberDesk() = default;

  /// The number of a member that nobody has taken yet; nothing when there are no more to run. May wait.
  [[nodiscard]] virtual std::optional<std::size_t> next() = 0;
  virtual void hand_in(std::size_t member, MemberResult result) = 0;
  /// What was thrown where a member was run, which ends the whole.
  virtual void fail(std::exception_ptr error) = 0;
  /// Asks runs to end where they are, as somebody does who interrupts them.
  virtual void halt() = 0;
  /// True if they are to: their results are not asked for any more.
  [[nodiscard]] virtual bool halted() const = 0;
  /// The flag that interrupts all; may be null.
  [[nodiscard]] virtual const std::atomic<bool>* interrupt() const = 0;
};

/// Runs members on all threads until there are no more: each by one thread from beginning to end. `figures`: the names
/// of those to show. What is thrown goes to the desk.
void run_members(const Problem& ensemble, const std::vector<std::string>& figures, MemberDesk& desk);

}  // namespace rubato
