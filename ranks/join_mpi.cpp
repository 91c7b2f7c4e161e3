// A build with MPI: the only source that knows it, beside record/together_mpi.cpp.

#include <mpi.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <thread>

#include <rubato/ranks/communicator.hpp>
#include <rubato/ranks/polling_delay.hpp>

namespace rubato::ranks {

namespace {

/// A message is its head, then its bytes in parts: MPI counts with an int.
constexpr int head_tag = 1, part_tag = 2, numbers_tag = 3;
constexpr std::size_t largest_part = std::size_t{1} << 30;
using Head = std::array<std::uint64_t, 2>;  ///< kind, and the number of bytes

class Job final : public Communicator {
public:
  /// \throws std::runtime_error if the library does not let a thread other than the first one call it
  Job() {
    // Libraries that wait inside of Open MPI, as HDF5 does, leave the processor to others too (see end_exchange()).
    setenv("OMPI_MCA_mpi_yield_when_idle", "1", 0);  // NOLINT(concurrency-mt-unsafe): nobody else runs yet
    int provided = MPI_THREAD_SINGLE;
    MPI_Init_thread(nullptr, nullptr, MPI_THREAD_SERIALIZED, &provided);
    // What goes wrong in the library ends all ranks, with its message: its default.
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &size_);
    if (provided < MPI_THREAD_SERIALIZED) {
      MPI_Finalize();
      throw std::runtime_error("this MPI library was built without support for threads, which is needed here");
    }
  }

  [[nodiscard]] int rank() const override { return rank_; }
  [[nodiscard]] int size() const override { return size_; }

  void send(int to, int kind, std::span<const std::byte> bytes) override {
    const Head head = {static_cast<std::uint64_t>(kind), bytes.size()};
    MPI_Request request = MPI_REQUEST_NULL;
    MPI_Isend(head.data(), static_cast<int>(head.size()), MPI_UINT64_T, to, head_tag, MPI_COMM_WORLD, &request);
    wait_for(request);
    for (std::size_t begin = 0; begin < bytes.size(); begin += largest_part) {
      const auto part = bytes.subspan(begin, std::min(largest_part, bytes.size() - begin));
      MPI_Isend(part.data(), static_cast<int>(part.size()), MPI_BYTE, to, part_tag, MPI_COMM_WORLD, &request);
      wait_for(request);
    }
  }

  [[nodiscard]] std::optional<Message> receive() override {
    int has_come = 0;
    MPI_Status status;
    MPI_Iprobe(MPI_ANY_SOURCE, head_tag, MPI_COMM_WORLD, &has_come, &status);
    if (has_come == 0) {
      return std::nullopt;
    }
    Head head{};
    MPI_Recv(head.data(), static_cast<int>(head.size()), MPI_UINT64_T, status.MPI_SOURCE, head_tag, MPI_COMM_WORLD,
             MPI_STATUS_IGNORE);
    Message message{.from = status.MPI_SOURCE, .kind = static_cast<int>(head[0]), .bytes = {}};
    message.bytes.resize(head[1]);
    for (std::size_t begin = 0; begin < message.bytes.size(); begin += largest_part) {
      const std::size_t count = std::min(largest_part, message.bytes.size() - begin);
      MPI_Recv(message.bytes.data() + begin, static_cast<int>(count), MPI_BYTE, message.from, part_tag, MPI_COMM_WORLD,
               MPI_STATUS_IGNORE);
    }
    return message;
  }

  void begin_exchange(std::span<const Outgoing> out, std::span<const Incoming> in) override {
    requests_.clear();
    for (const Incoming& numbers : in) {
      MPI_Irecv(numbers.values.data(), counted(numbers.values.size()), MPI_DOUBLE, numbers.from, numbers_tag,
                MPI_COMM_WORLD, &requests_.emplace_back());
    }
    for (const Outgoing& numbers : out) {
      MPI_Isend(numbers.values.data(), counted(numbers.values.size()), MPI_DOUBLE, numbers.to, numbers_tag,
                MPI_COMM_WORLD, &requests_.emplace_back());
    }
  }

  void end_exchange() override {
    // MPI_Waitall() never leaves the processor to others: where other programs had two processors as well, two ranks
    // took twice as long with it as one rank did, and as long as one without.
    constexpr int looks = 200;
    for (int look = 0; !are_done(requests_); ++look) {
      if (look >= looks) {
        std::this_thread::yield();
      }
    }
  }

  [[nodiscard]] const void* mpi() const override { return &world_; }

  bool leave(std::chrono::duration<double> patience) override {
    const auto end = std::chrono::steady_clock::now() + patience;
    MPI_Request request = MPI_REQUEST_NULL;
    MPI_Ibarrier(MPI_COMM_WORLD, &request);
    PollingDelay delay;
    while (!is_done(request)) {
      if (std::chrono::steady_clock::now() > end) {
        return false;
      }
      delay.wait();
    }
    MPI_Finalize();
    return true;
  }

private:
  static int counted(std::size_t size) {
    if (size > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
      throw std::runtime_error("more than 2147483647 numbers for one message between ranks: take more ranks");
    }
    return static_cast<int>(size);
  }
  static bool are_done(std::vector<MPI_Request>& requests) {
    int done = 0;
    MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done, MPI_STATUSES_IGNORE);
    return done != 0;
  }
  static bool is_done(MPI_Request& request) {
    int done = 0;
    MPI_Test(&request, &done, MPI_STATUS_IGNORE);
    return done != 0;
  }
  /// The library itself would wait without ever leaving the processor to others.
  static void wait_for(MPI_Request& request) {
    PollingDelay delay;
    while (!is_done(request)) {
      delay.wait();
    }
  }

  int rank_ = 0, size_ = 1;
  MPI_Comm world_ = MPI_COMM_WORLD;
  std::vector<MPI_Request> requests_;
};

/// A process that no launcher started has nobody to talk to: it does without the library, which takes a tenth of a
/// second to begin.
bool was_launched() {
  // Set by Open MPI, PMIx, and the PMI of MPICH, Intel MPI and Slurm.
  constexpr std::array marks = {"OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "PMI_SIZE"};
  return std::ranges::any_of(marks, [](const char* mark) { return std::getenv(mark) != nullptr; });
}

}  // namespace

std::unique_ptr<Communicator> join() {
  if (was_launched()) {
    return std::make_unique<Job>();
  }
  return std::make_unique<Alone>();
}

bool joins() {
  return was_launched();
}

}  // namespace rubato::ranks
