#pragma once

#include <algorithm>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include <rubato/ranks/communicator.hpp>
#include <rubato/study/ensemble_ranks.hpp>

namespace rubato::study_tests {

/// Ranks that are threads of one process, with letter boxes in memory in place of MPI.
class Mailboxes {
public:
  /// Called with every message before it is put into its box.
  using Censor = std::function<void(ranks::Message&)>;

  explicit Mailboxes(
      int size, Censor censor = [](ranks::Message&) {})
      : boxes_(static_cast<std::size_t>(size)), censor_(std::move(censor)) {}

  class Rank final : public ranks::Communicator {
  public:
    Rank(Mailboxes& all, int rank) : all_(all), rank_(rank) {}
    [[nodiscard]] int rank() const override { return rank_; }
    [[nodiscard]] int size() const override { return static_cast<int>(all_.boxes_.size()); }
    void send(int to, int kind, std::span<const std::byte> bytes) override {
      ranks::Message message{rank_, kind, {bytes.begin(), bytes.end()}};
      const std::scoped_lock lock(all_.mutex_);
      all_.censor_(message);
      all_.boxes_.at(static_cast<std::size_t>(to)).push_back(std::move(message));
    }
    [[nodiscard]] std::optional<ranks::Message> receive() override {
      const std::scoped_lock lock(all_.mutex_);
      auto& box = all_.boxes_[static_cast<std::size_t>(rank_)];
      if (box.empty()) {
        return std::nullopt;
      }
      ranks::Message message = std::move(box.front());
      box.pop_front();
      return message;
    }
    bool leave(std::chrono::duration<double> /*patience*/) override { return true; }

  private:
    Mailboxes& all_;
    int rank_;
  };

private:
  std::mutex mutex_;
  std::vector<std::deque<ranks::Message>> boxes_;
  Censor censor_;
};

/// Calls command(rank 0) while all other ranks help. `interrupt` is that of the last rank.
template <class Command>
auto with_ranks(
    int size, const Command& command, Mailboxes::Censor censor = [](ranks::Message&) {},
    const std::atomic<bool>* interrupt = nullptr) {
  Mailboxes all(size, std::move(censor));
  Mailboxes::Rank first(all, 0);
  struct Helpers {
    explicit Helpers(Mailboxes::Rank& leader) : leader_(leader) {}
    ~Helpers() {
      study::dismiss(leader_);
      std::ranges::for_each(threads, &std::thread::join);
    }
    std::vector<std::thread> threads;

  private:
    Mailboxes::Rank& leader_;
  } helpers(first);
  for (int rank = 1; rank < size; ++rank) {
    helpers.threads.emplace_back([&all, rank, mine = rank + 1 == size ? interrupt : nullptr] {
      Mailboxes::Rank helper(all, rank);
      study::help_rank_0(helper, mine);
    });
  }
  return command(first);
}

}  // namespace rubato::study_tests
