#pragma once

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include <rubato/ranks/communicator.hpp>
#include <rubato/run/ensemble_member.hpp>

/// The members of an ensemble, run by the ranks of a job. Rank 0 is the run: it reads the problem, hands out members as
/// ranks ask for them, runs some itself, publishes results in the order of the members, and says what there is to say.
/// The others wait for work and send back what they find, so that no file is written, and nothing printed, but by rank
/// 0, and what the record holds does not depend on the number of ranks.
namespace rubato {

/// What ranks have to know of an ensemble to run its members.
struct EnsembleWork {
  const Problem& problem;
  const std::vector<std::string>& figures;
  int threads = 0;  ///< of each rank; 0 for OpenMP's choice
};

/// At rank 0, while it lives: the other ranks take members from the desk and hand them in there. They may be reported
/// to halt, by the desk; one that is interrupted halts all. Nothing where there is no other rank.
class OtherRanks {
public:
  OtherRanks(ranks::Communicator* ranks, EnsembleWork work, MemberDesk& desk);
  OtherRanks(const OtherRanks&) = delete;
  OtherRanks& operator=(const OtherRanks&) = delete;
  /// Waits until the others have handed in what they have; where the desk has halted, for a moment at most.
  ~OtherRanks();

private:
  std::thread service_;  ///< the only one that talks to the others, meanwhile
};

/// What has to be the same of all ranks: version and compiler of the program.
[[nodiscard]] std::string build_of_ranks();

/// What a rank other than 0 does, from the beginning of the process to its end: it waits for work of rank 0, until
/// dismiss().
void help_rank_0(ranks::Communicator& ranks, const std::atomic<bool>* interrupt);
/// Sends the other ranks home.
void dismiss(ranks::Communicator& ranks);

/// A command that is for one process. \throws ProblemError at `location` if there are more ranks
void refuse_ranks(const RunOptions& options, const Location& location);

}  // namespace rubato
