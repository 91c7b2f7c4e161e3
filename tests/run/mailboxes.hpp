#pragma once

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>
#include <vector>

#include <rubato/ranks/communicator.hpp>
#include <rubato/run/ensemble_ranks.hpp>

namespace rubato::run_tests {

/// Ranks that are threads of one process, with letter boxes in memory in place of MPI.
class Mailboxes {
public:
  /// Called with every message before it is put into its box.
  using Censor = std::function<void(ranks::Message&)>;

  explicit Mailboxes(
      int size, Censor censor = [](ranks::Message&) {})
      : has_come_(static_cast<std::size_t>(size)), boxes_(static_cast<std::size_t>(size)), censor_(std::move(censor)) {}

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
    void begin_exchange(std::span<const Outgoing> out, std::span<const Incoming> in) override {
      for (const Outgoing& numbers : out) {
        {
          const std::scoped_lock lock(all_.mutex_);
          auto& box = all_.numbers_[{rank_, numbers.to}];
          box.emplace_back(numbers.values.begin(), numbers.values.end());
          all_.tamper_(rank_, box.back());
          all_.sent_ += numbers.values.size();
          ++all_.exchanges_;
        }
        all_.has_come_[static_cast<std::size_t>(numbers.to)].notify_one();
      }
      expected_.assign(in.begin(), in.end());
    }
    void end_exchange() override {
      for (const Incoming& numbers : expected_) {
        std::unique_lock lock(all_.mutex_);
        auto& box = all_.numbers_[{numbers.from, rank_}];
        for (int turn = 0; box.empty() && turn < turns_before_sleep; ++turn) {  // going to sleep takes longer
          lock.unlock();
          std::this_thread::yield();
          lock.lock();
        }
        if (!all_.has_come_[static_cast<std::size_t>(rank_)].wait_for(lock, std::chrono::minutes(10),
                                                                      [&box] { return !box.empty(); })) {
          throw std::runtime_error("ranks wait for each other");
        }
        if (box.front().size() != numbers.values.size()) {
          throw std::runtime_error("ranks do not agree on the size of what they exchange");
        }
        std::ranges::copy(box.front(), numbers.values.begin());
        box.pop_front();
      }
    }
    bool leave(std::chrono::duration<double> /*patience*/) override { return true; }

  private:
    Mailboxes& all_;
    int rank_;
    std::vector<Incoming> expected_;
  };

  /// Called with every array of numbers before it is put into its box.
  using Tamper = std::function<void(int from, std::vector<double>& numbers)>;
  void tamper_with(Tamper tamper) { tamper_ = std::move(tamper); }
  /// Numbers that exchange() has sent, and how many times.
  [[nodiscard]] std::size_t sent() const { return sent_; }
  [[nodiscard]] std::size_t exchanges() const { return exchanges_; }

private:
  static constexpr int turns_before_sleep = 50;

  std::mutex mutex_;
  std::vector<std::condition_variable> has_come_;  ///< for each rank
  std::map<std::pair<int, int>, std::deque<std::vector<double>>> numbers_;
  Tamper tamper_ = [](int, std::vector<double>&) {};
  std::size_t sent_ = 0, exchanges_ = 0;
  std::vector<std::deque<ranks::Message>> boxes_;
  Censor censor_;
};

/// Calls command(rank 0) while all other ranks help. `interrupt` is that of the last rank.
template <class Command>
auto with_ranks(Mailboxes& all, const Command& command, const std::atomic<bool>* interrupt = nullptr) {
  Mailboxes::Rank first(all, 0);
  struct Helpers {
    explicit Helpers(Mailboxes::Rank& leader) : leader_(leader) {}
    ~Helpers() {
      rubato::dismiss(leader_);
      std::ranges::for_each(threads, &std::thread::join);
    }
    std::vector<std::thread> threads;

  private:
    Mailboxes::Rank& leader_;
  } helpers(first);
  for (int rank = 1; rank < first.size(); ++rank) {
    helpers.threads.emplace_back([&all, rank, mine = rank + 1 == first.size() ? interrupt : nullptr] {
      Mailboxes::Rank helper(all, rank);
      rubato::help_rank_0(helper, mine);
    });
  }
  return command(first);
}

template <class Command>
auto with_ranks(
    int size, const Command& command, Mailboxes::Censor censor = [](ranks::Message&) {},
    const std::atomic<bool>* interrupt = nullptr) {
  Mailboxes all(size, std::move(censor));
  return with_ranks(all, command, interrupt);
}

}  // namespace rubato::run_tests
