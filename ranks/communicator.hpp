#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

/// The processes that a launcher (mpirun) started together for one command; nobody else knows MPI.
namespace rubato::ranks {

/// What one rank sends another: a number that says what it is, and bytes.
struct Message {
  int from = 0;
  int kind = 0;
  std::vector<std::byte> bytes;
};

/// The ranks of a job, numbered from 0, and what they say to each other. Messages from one rank to another arrive in
/// the order in which they were sent. One thread at a time may call.
class Communicator {
public:
  Communicator() = default;
  Communicator(const Communicator&) = delete;
  Communicator& operator=(const Communicator&) = delete;
  virtual ~Communicator() = default;

  [[nodiscard]] virtual int rank() const = 0;
  [[nodiscard]] virtual int size() const = 0;

  /// Sends bytes, any number of them; returns when they are on their way. Hypothesis: `to` is another rank, which
  /// receives sooner or later.
  virtual void send(int to, int kind, std::span<const std::byte> bytes) = 0;
  /// A message that has come, the earliest of its sender; nothing if there is none. Does not wait.
  [[nodiscard]] virtual std::optional<Message> receive() = 0;

  /// Numbers for another rank, and room for those that another sends.
  struct Outgoing {
    int to = 0;
    std::span<const double> values;
  };
  struct Incoming {
    int from = 0;
    std::span<double> values;
  };
  /// Sends and receives all that is listed, and returns when it has come. What one rank sends another meets what that
  /// one expects in the order of the calls, and of the lists; the sizes agree. No other messages are waited for
  /// meanwhile.
  void exchange(std::span<const Outgoing> out, std::span<const Incoming> in) {
    begin_exchange(out, in);
    end_exchange();
  }
  /// The same in two calls, between which this rank does something else: what goes out stays as it is, what comes in
  /// may be there or not, and nothing else is exchanged.
  ///@{
  virtual void begin_exchange(std::span<const Outgoing> out, std::span<const Incoming> in) = 0;
  virtual void end_exchange() = 0;
  ///@}

  /// For libraries that speak MPI themselves: where the MPI_Comm of these ranks is; null without MPI.
  [[nodiscard]] virtual const void* mpi() const { return nullptr; }

  /// Ends the job in good order when all ranks have called it. False if some have not within `patience`: the launcher
  /// then ends them when this process ends. No other call may follow.
  virtual bool leave(std::chrono::duration<double> patience) = 0;
};

/// One process by itself.
class Alone final : public Communicator {
public:
  [[nodiscard]] int rank() const override { return 0; }
  [[nodiscard]] int size() const override { return 1; }
  void send(int to, int kind, std::span<const std::byte> bytes) override;  ///< \throws std::logic_error
  [[nodiscard]] std::optional<Message> receive() override { return std::nullopt; }
  /// \throws std::logic_error
  void begin_exchange(std::span<const Outgoing> out, std::span<const Incoming> in) override;
  void end_exchange() override {}
  bool leave(std::chrono::duration<double> /*patience*/) override { return true; }
};

/// The job that this process was started in: Alone where no launcher started it, or in a build without MPI. To be
/// called once in a process. \throws std::runtime_error if the MPI library cannot be used so
[[nodiscard]] std::unique_ptr<Communicator> join();

/// True if join() starts the MPI library, which a process can do once: where a launcher started it, in a build with
/// MPI.
[[nodiscard]] bool joins();

}  // namespace rubato::ranks
