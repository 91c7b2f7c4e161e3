#include <rubato/run/ensemble_ranks.hpp>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <new>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/ranks/packet.hpp>
#include <rubato/ranks/polling_delay.hpp>
#include <rubato/record/error.hpp>
#include <rubato/run/lattice_ranks.hpp>
#include <rubato/run/threads.hpp>
#include <rubato/run/version.hpp>

namespace rubato {

namespace {

using ranks::Message;
using ranks::Packet;
using ranks::PacketReader;
using ranks::PollingDelay;

/// What a message is. Rank 0 sends the first five, the others the rest.
enum Kind : int {
  work_to_do,
  take_member,  ///< its number
  no_more_members,
  halt_now,  ///< may come late, when the rank has left
  go_home,
  ask_for_member,
  member_is_done,  ///< its number and result
  rank_has_failed,
  rank_has_left,  ///< the present work, and whether because it was interrupted
};

/// How long ranks that were asked to halt are waited for before the record is closed without them. Where one of them
/// has died, the launcher gives all others about a second from its first signal.
constexpr std::chrono::milliseconds patience{200};

void put(Packet& packet, const MemberResult& result) {
  packet.number(static_cast<std::uint64_t>(result.status)).text(result.message).numbers(result.figures);
  packet.number(result.warnings.size());
  for (const std::string& warning : result.warnings) {
    packet.text(warning);
  }
  packet.number(static_cast<std::uint64_t>(result.judgement.verdict)).number(result.judgement.reasons.size());
  for (const figures::Reason& reason : result.judgement.reasons) {
    packet.number(static_cast<std::uint64_t>(reason.kind)).number(static_cast<std::uint64_t>(reason.verdict));
    packet.numbers(std::vector<double>{reason.value}).text(reason.finding).text(reason.remedy);
  }
  for (const auto* rows : {&result.states, &result.series}) {
    packet.number(rows->size());
    for (const std::vector<double>& row : *rows) {
      packet.numbers(row);
    }
  }
}

MemberResult take_result(PacketReader& packet) {
  MemberResult result;
  result.status = static_cast<ExitStatus>(packet.number());
  result.message = packet.text();
  result.figures = packet.numbers();
  result.warnings.resize(packet.number());
  for (std::string& warning : result.warnings) {
    warning = packet.text();
  }
  result.judgement.verdict = static_cast<figures::Verdict>(packet.number());
  result.judgement.reasons.resize(packet.number());
  for (figures::Reason& reason : result.judgement.reasons) {
    reason.kind = static_cast<figures::ReasonKind>(packet.number());
    reason.verdict = static_cast<figures::Verdict>(packet.number());
    reason.value = packet.numbers().front();
    reason.finding = packet.text();
    reason.remedy = packet.text();
  }
  for (auto* rows : {&result.states, &result.series}) {
    for (std::uint64_t left = packet.number(); left > 0; --left) {
      rows->push_back(packet.numbers());
    }
  }
  return result;
}

/// What was thrown at another rank, as rank 0 throws it on: by the exit status that it leads to.
void put(Packet& packet, const std::exception_ptr& error) {
  const auto put_status = [&packet](ExitStatus status, const char* reason) {
    packet.number(static_cast<std::uint64_t>(status)).text(reason);
  };
  try {
    std::rethrow_exception(error);
  } catch (const std::invalid_argument& thrown) {
    put_status(ExitStatus::wrong_input, thrown.what());
  } catch (const record::Error& thrown) {
    put_status(ExitStatus::file_error, thrown.what());
  } catch (const FileError& thrown) {
    put_status(ExitStatus::file_error, thrown.what());
  } catch (const std::bad_alloc&) {
    put_status(ExitStatus::failed, "there is not enough memory for a member");
  } catch (const std::exception& thrown) {
    put_status(ExitStatus::failed, thrown.what());
  }
}

/// What is wrong with the problem is so at every rank; all else depends on where it happens.
std::exception_ptr take_error(PacketReader& packet, int rank) {
  const auto status = static_cast<ExitStatus>(packet.number());
  const std::string reason = packet.text(), reported = fmt::format("on rank {}: {}", rank, reason);
  switch (status) {
    case ExitStatus::wrong_input: return std::make_exception_ptr(std::invalid_argument(reason));
    case ExitStatus::file_error: return std::make_exception_ptr(FileError(reported));
    default: return std::make_exception_ptr(std::runtime_error(reported));
  }
}

/// Rank 0 answers the others, until all have left.
class Service {
public:
  Service(ranks::Communicator& ranks, EnsembleWork work, MemberDesk& desk)
      : ranks_(ranks), work_(work), desk_(desk), working_(ranks.size() - 1) {}

  void run() {
    try {
      hand_out_work();
      while (working_ > 0 && !is_given_up()) {
        if (const auto message = ranks_.receive()) {
          delay_.restart();
          answer(*message);  // what it throws has gone to the desk
        } else {
          delay_.wait();
        }
      }
    } catch (...) {
      desk_.fail(std::current_exception());
    }
  }

private:
  using Clock = std::chrono::steady_clock;

  void hand_out_work() {
    Packet packet;
    packet.text(build_of_ranks()).text(work_.problem.text).text(work_.problem.source);
    packet.number(static_cast<std::uint64_t>(work_.threads)).number(work_.figures.size());
    for (const std::string& name : work_.figures) {
      packet.text(name);
    }
    send_to_all(work_to_do, packet);
  }
  void send_to_all(Kind kind, const Packet& packet) {
    for (int rank = 1; rank < ranks_.size(); ++rank) {
      ranks_.send(rank, kind, packet.bytes());
    }
  }

  /// Reports to the others to halt where the desk has; true when they had their time for it.
  bool is_given_up() {
    if (desk_.halted() && !halted_) {
      halted_ = Clock::now();
      send_to_all(halt_now, {});
    }
    return halted_ && Clock::now() > *halted_ + patience;
  }

  void answer(const Message& message) {
    try {
      PacketReader packet(message.bytes);
      switch (message.kind) {
        case ask_for_member: {
          const std::optional<std::size_t> member = desk_.next();
          const Kind kind = member ? take_member : no_more_members;
          ranks_.send(message.from, kind, Packet().number(member.value_or(0)).bytes());
          break;
        }
        case member_is_done: {
          const std::size_t member = packet.number();
          desk_.hand_in(member, take_result(packet));
          break;
        }
        case rank_has_failed: desk_.fail(take_error(packet, message.from)); break;
        case rank_has_left:
          --working_;
          if (packet.number() != 0) {
            desk_.halt();
          }
          break;
        default: break;
      }
    } catch (...) {
      desk_.fail(std::current_exception());
    }
  }

  ranks::Communicator& ranks_;
  EnsembleWork work_;
  MemberDesk& desk_;
  int working_;
  PollingDelay delay_;
  std::optional<Clock::time_point> halted_;
};

/// Another rank's desk: what its threads ask for and hand in goes to rank 0 by one more thread, which alone talks.
class RemoteDesk final : public MemberDesk {
public:
  RemoteDesk(ranks::Communicator& ranks, const std::atomic<bool>* interrupt)
      : ranks_(ranks), interrupt_(interrupt), talking_([this] { talk(); }) {}
  ~RemoteDesk() override { close(); }

  /// Sends what is left to send; whether rank 0, tired of waiting, has sent this one home.
  bool close() {
    {
      const std::scoped_lock lock(mutex_);
      is_over_ = true;
    }
    to_send_.notify_one();
    if (talking_.joinable()) {
      talking_.join();
    }
    return dismissed_;
  }

  [[nodiscard]] std::optional<std::size_t> next() override {
    std::unique_lock lock(mutex_);
    ask(ask_for_member, {});
    // Signals wake nobody: whether there was one is looked at now and then.
    while (numbers_.empty() && !no_more_ && !halted()) {
      has_come_.wait_for(lock, std::chrono::milliseconds(50));
    }
    if (numbers_.empty() || halted()) {
      return std::nullopt;
    }
    const std::size_t number = numbers_.front();
    numbers_.pop_front();
    return number;
  }
  void hand_in(std::size_t member, MemberResult result) override {
    Packet packet;
    packet.number(member);
    put(packet, result);
    const std::scoped_lock lock(mutex_);
    ask(member_is_done, std::move(packet));
  }
  void fail(std::exception_ptr error) override {
    Packet packet;
    put(packet, error);
    const std::scoped_lock lock(mutex_);
    ask(rank_has_failed, std::move(packet));
    halted_ = true;
  }
  void halt() override { halted_ = true; }
  [[nodiscard]] bool halted() const override { return halted_.load() || interrupted(); }
  [[nodiscard]] const std::atomic<bool>* interrupt() const override { return interrupt_; }
  [[nodiscard]] bool interrupted() const { return interrupt_ != nullptr && interrupt_->load(); }

private:
  /// Hypothesis: mutex_ is held.
  void ask(Kind kind, Packet packet) {
    outgoing_.emplace_back(kind, std::move(packet));
    to_send_.notify_one();
  }

  void talk() {
    PollingDelay delay;
    std::unique_lock lock(mutex_);
    while (true) {
      while (!outgoing_.empty()) {
        const auto [kind, packet] = std::move(outgoing_.front());
        outgoing_.pop_front();
        lock.unlock();
        ranks_.send(0, kind, packet.bytes());
        lock.lock();
        delay.restart();
      }
      if (is_over_) {
        return;
      }
      lock.unlock();
      const auto message = ranks_.receive();
      lock.lock();
      if (message) {
        delay.restart();
        take(*message);
      } else {
        to_send_.wait_for(lock, delay.next(), [this] { return !outgoing_.empty() || is_over_; });
      }
    }
  }
  void take(const Message& message) {
    if (message.kind == take_member) {
      numbers_.push_back(PacketReader(message.bytes).number());
    }
    no_more_ = no_more_ || message.kind == no_more_members;
    dismissed_ = dismissed_ || message.kind == go_home;
    if (message.kind == halt_now || dismissed_) {
      halted_ = true;
    }
    has_come_.notify_all();
  }

  ranks::Communicator& ranks_;
  const std::atomic<bool>* interrupt_;
  std::atomic<bool> halted_ = false;
  std::mutex mutex_;  ///< of all that follows
  std::condition_variable has_come_, to_send_;
  std::deque<std::size_t> numbers_;
  std::deque<std::pair<Kind, Packet>> outgoing_;
  bool no_more_ = false, is_over_ = false, dismissed_ = false;
  std::thread talking_;  ///< the last, since it uses all others
};

/// Carries out the work of a message; whether there will be no more.
bool carry_out(ranks::Communicator& ranks, const Message& message, const std::atomic<bool>* interrupt) {
  RemoteDesk desk(ranks, interrupt);
  try {
    PacketReader packet(message.bytes);
    if (const std::string other = packet.text(); other != build_of_ranks()) {
      throw std::runtime_error(
          fmt::format("this is rubato {}, and rank 0 is {}: all have to be the same", build_of_ranks(), other));
    }
    const std::string text = packet.text(), source = packet.text();
    const ThreadCount threads(static_cast<int>(packet.number()));
    std::vector<std::string> figures(packet.number());
    for (std::string& name : figures) {
      name = packet.text();
    }
    run_members(parse_recorded(text, source), figures, desk);
  } catch (...) {
    desk.fail(std::current_exception());
  }
  const bool interrupted = desk.interrupted(), dismissed = desk.close();
  ranks.send(0, rank_has_left, Packet().number(interrupted ? 1 : 0).bytes());
  return dismissed;
}

}  // namespace

OtherRanks::OtherRanks(ranks::Communicator* ranks, EnsembleWork work, MemberDesk& desk) {
  if (ranks != nullptr && ranks->size() > 1) {
    service_ = std::thread([ranks, work, &desk] { Service(*ranks, work, desk).run(); });
  }
}

OtherRanks::~OtherRanks() {
  if (service_.joinable()) {
    service_.join();
  }
}

std::string build_of_ranks() {
  return fmt::format("{}, {}", version(), compiler());
}

void help_rank_0(ranks::Communicator& ranks, const std::atomic<bool>* interrupt) {
  for (PollingDelay delay;;) {
    const auto message = ranks.receive();
    if (!message) {
      delay.wait();
    } else if (message->kind == work_to_do) {
      if (carry_out(ranks, *message, interrupt)) {
        return;
      }
      delay.restart();
    } else if (message->kind == lattice_to_do) {
      follow_leader(ranks, message->bytes);
      delay.restart();
    } else if (message->kind == go_home) {
      return;
    }
  }
}

void dismiss(ranks::Communicator& ranks) {
  for (int rank = 1; rank < ranks.size(); ++rank) {
    ranks.send(rank, go_home, {});
  }
}

void refuse_ranks(const RunOptions& options, const Location& location) {
  if (options.ranks != nullptr && options.ranks->size() > 1) {
    throw ProblemError(location, fmt::format("{} ranks cannot share this command; start it without mpirun (--threads "
                                             "says on how many threads it runs)",
                                             options.ranks->size()));
  }
}

}  // namespace rubato
