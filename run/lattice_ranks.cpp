#include <rubato/run/lattice_ranks.hpp>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/pde/lattice_method.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/ranks/packet.hpp>
#include <rubato/run/ensemble_ranks.hpp>
#include <rubato/run/gathering_sink.hpp>
#include <rubato/run/lattice_check.hpp>
#include <rubato/run/observed_run.hpp>
#include <rubato/run/shared_rows.hpp>
#include <rubato/run/threads.hpp>
#include <rubato/run/version.hpp>

namespace rubato {

namespace {

[[noreturn]] void refuse_sharing(const Location& location, int ranks, const std::string& reason) {
  throw ProblemError(location,
                     fmt::format("{} ranks cannot share this run: {}; start it without mpirun (--threads says "
                                 "on how many threads it runs)",
                                 ranks, reason));
}

/// On such a grid: "euler-box", …
std::string methods_to_share(const grids::Grid& grid) {
  const int dimensions = grid.dimensions();
  std::vector<std::string> names;
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    const LatticeMethodChoice choice{.name = std::string(entry.name)};
    if (make_lattice_method(choice, grid)->not_shared_in(dimensions).empty()) {
      names.push_back(
          fmt::format("\"{}\"{}", entry.name, entry.has_stages && dimensions == 1 ? " with one stage" : ""));
    }
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

grids::Ghosts ghosts_of(const Problem& problem, const MultisymplecticSystem& system) {
  try {
    return make_method(problem)->ghosts(system);
  } catch (const std::invalid_argument& error) {
    throw ProblemError(problem.scheme.lagrangian_location, error.what());
  }
}

grids::Slab make_slab(ranks::Communicator& ranks, const Problem& problem, bool tangents) {
  const grids::Grid whole = make_grid(problem);
  const MultisymplecticSystem system = make_system(problem);
  const grids::Ghosts ghosts = ghosts_of(problem, system);
  const double direction = problem.scheme.until < problem.start() ? -1.0 : 1.0;  // of a step to be chosen
  try {
    auto parts = make_method(problem)->parts(system, whole, problem.scheme.step.value_or(direction), ranks.size());
    if (tangents && !parts.empty() && parts != box_tangent_parts(system, whole, ranks.size())) {
      refuse_sharing(problem.scheme.lagrangian_location, ranks.size(),
                     "tangent solutions (--tangents) are solved for more fields than steps are, in shorter chunks of "
                     "cells, at which the parts of ranks do not end");
    }
    return {ranks, whole, ghosts, std::move(parts)};
  } catch (const ProblemError&) {
    throw;
  } catch (const std::invalid_argument& error) {
    throw ProblemError(problem.multisymplectic()->axes.back().location, error.what());
  }
}

/// Of rank 0, by all.
Order take_order(const grids::Slab& slab) {
  double order = 0.0;
  slab.broadcast(std::span(&order, 1));
  return static_cast<Order>(static_cast<int>(order));
}

/// What rank 0 orders, at another rank.
class Follower {
public:
  Follower(const Problem& problem, bool tangents, const grids::Slab& slab)
      : problem_(problem), tangents_(tangents), slab_(slab) {}

  void carry_out(Order order) {
    if (order == Order::make) {
      observed_ = std::make_unique<ObservedRun>(problem_, tangents_);
      return;
    }
    if (observed_ == nullptr && order != Order::check) {
      throw std::logic_error("rank 0 goes on with a lattice that could not be made here");
    }
    switch (order) {
      case Order::start: gathered([this](RowSink& sink) { observed_->append_start(sink); }); break;
      case Order::step: step(); break;
      case Order::save: save(); break;
      case Order::restore: restore(); break;
      case Order::state: append_state(); break;
      case Order::check: check(); break;
      case Order::last: gathered([this](RowSink& sink) { observed_->append_last(sink); }); break;
      case Order::finish: static_cast<void>(observed_->final_statistics()); break;
      case Order::make:
      case Order::end: break;
    }
  }

private:
  /// Calls show(sink) with one that gathers what is reported.
  template <typename Write>
  void gathered(const Write& write) {
    GatheringSink sink(slab_, observed_->layout(), nullptr);
    write(sink);
    sink.finish();
  }
  void step() {
    Simulation& simulation = observed_->simulation();
    observed_->take(1);
    if (!simulation.taken().empty()) {
      gathered([&](RowSink& sink) { observed_->append_steps(sink); });
    } else {
      static_cast<void>(simulation.integrator().explain(simulation.report()));
    }
  }
  void save() {
    StateWriter state(StateWriter::For::record, nullptr);
    observed_->save(state);
  }
  void append_state() {
    double reported = 0.0;
    slab_.broadcast(std::span(&reported, 1));
    static_cast<void>(observed_->simulation().node());
    if (reported != 0.0) {
      gathered([this](RowSink& sink) { observed_->append_state(sink); });
    }
  }
  void check() {
    observed_.reset();
    double has_gamma = 0.0;
    slab_.broadcast(std::span(&has_gamma, 1));
    const SharedRecord record(&slab_, nullptr);
    const StoredLevels levels = shared_levels(record, nullptr);
    Disagreements of_rank_0;
    static_cast<void>(check_lattice(record, levels, problem_, has_gamma != 0.0, of_rank_0));
  }
  void restore() {
    double size = 0.0;
    slab_.broadcast(std::span(&size, 1));
    SharedState source(slab_, nullptr);
    StateReader state(source, static_cast<std::size_t>(size));
    observed_->restore(state);
  }

  const Problem& problem_;
  bool tangents_;
  const grids::Slab& slab_;
  std::unique_ptr<ObservedRun> observed_;
};

}  // namespace

void end_job(const ranks::Communicator& ranks, const std::exception& error, ExitStatus status) {
  std::fputs(fmt::format("rubato: error: on rank {}: {}\n", ranks.rank(), error.what()).c_str(), stderr);
  std::fflush(nullptr);
  std::_Exit(static_cast<int>(status));
}

void refuse_unshared(const Problem& problem, const RunOptions& options) {
  if (options.ranks == nullptr || options.ranks->size() == 1) {
    return;
  }
  const int ranks = options.ranks->size();
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  if (pde == nullptr) {
    refuse_sharing(problem.hamiltonian()->statement().location, ranks,
                   "it is one orbit; they share lattices, and the members of an [ensemble]");
  }
  if (const StatedSponge* const sponge = pde->sponge()) {
    refuse_sharing(sponge->location, ranks, "a sponge finds the constrained fields of each level on the whole lattice");
  }
  const Location& scheme = problem.scheme.lagrangian_location;
  const int dimensions = static_cast<int>(pde->axes.size());
  if (const auto reason = make_method(problem)->not_shared_in(dimensions); !reason.empty()) {
    refuse_sharing(scheme, ranks,
                   fmt::format("{}; a {} is shared with lagrangian = {}", reason, dimensions == 1 ? "line" : "lattice",
                               methods_to_share(make_grid(problem))));
  }
}

SharedLattice::SharedLattice(ranks::Communicator& ranks, const Problem& problem, bool tangents)
    : slab_(make_slab(ranks, problem, tangents)), shared_(&slab_) {}

LatticeLeader::LatticeLeader(ranks::Communicator& ranks, const Problem& problem, int threads, bool tangents)
    : problem_(problem), lattice_(ranks, problem, tangents) {
  ranks::Packet packet;
  packet.text(build_of_ranks())
      .text(problem.text)
      .text(problem.source)
      .number(static_cast<std::uint64_t>(threads))
      .number(tangents ? 1 : 0)
      .number(problem.laws.fields ? 1 : 0)
      .number(problem.output.all_fields ? 1 : 0);
  for (int rank = 1; rank < ranks.size(); ++rank) {
    ranks.send(rank, lattice_to_do, packet.bytes());
  }
}

LatticeLeader::~LatticeLeader() {
  order(Order::end);
}

void LatticeLeader::order(Order order) const {
  auto number = static_cast<double>(static_cast<int>(order));
  slab().broadcast(std::span(&number, 1));
}

void LatticeLeader::order_restore(std::size_t size) const {
  order(Order::restore);
  auto number = static_cast<double>(size);
  slab().broadcast(std::span(&number, 1));
}

void LatticeLeader::order_state(bool reported) const {
  order(Order::state);
  double number = reported ? 1.0 : 0.0;
  slab().broadcast(std::span(&number, 1));
}

Spread LatticeLeader::check(const record::Reader& reader, const StoredLevels& levels, bool has_gamma,
                            Disagreements& findings) const {
  order(Order::check);
  double number = has_gamma ? 1.0 : 0.0;
  slab().broadcast(std::span(&number, 1));
  const SharedRecord record(&slab(), &reader);
  static_cast<void>(shared_levels(record, &levels));
  return check_lattice(record, levels, problem_, has_gamma, findings);
}

void SharedState::read(std::span<double> values) {
  read_alone(values);
  slab_.broadcast(values);
}

void SharedState::read_alone(std::span<double> values) {
  if (record_ == nullptr) {
    return;
  }
  constexpr std::size_t at_once = std::size_t{1} << 16;
  for (double& value : values) {
    if (taken_ == waiting_.size()) {
      taken_ = 0;
      try {
        if (!thrown_) {
          const std::size_t count = std::min(at_once, record_->rows(shared_state) - next_);
          waiting_ = record_->read(shared_state, next_, count);
          next_ += count;
        }
      } catch (...) {
        thrown_ = std::current_exception();
      }
      if (thrown_) {  // others wait for as many numbers as were announced
        waiting_.assign(at_once, 0.0);
      }
    }
    value = waiting_[taken_++];
  }
}

void SharedState::rethrow() const {
  if (thrown_) {
    std::rethrow_exception(thrown_);
  }
}

void follow_leader(ranks::Communicator& ranks, std::span<const std::byte> message) {
  try {
    ranks::PacketReader packet(message);
    if (const std::string other = packet.text(); other != build_of_ranks()) {
      throw std::runtime_error(
          fmt::format("this is rubato {}, and rank 0 is {}: all have to be the same", build_of_ranks(), other));
    }
    const std::string text = packet.text(), source = packet.text();
    const int threads = static_cast<int>(packet.number());
    const bool tangents = packet.number() != 0;
    Problem problem = parse_recorded(text, source);
    problem.laws.fields = packet.number() != 0;
    problem.output.all_fields = packet.number() != 0;
    const ThreadCount thread_count(threads, problem);
    const SharedLattice lattice(ranks, problem, tangents);
    Follower follower(problem, tangents, lattice.slab());
    for (Order order = take_order(lattice.slab()); order != Order::end; order = take_order(lattice.slab())) {
      try {
        follower.carry_out(order);
      } catch (const std::invalid_argument&) {
        // What is wrong with a problem or a record is found at rank 0 as well, which then ends it.
      }
    }
  } catch (const record::Error& error) {
    end_job(ranks, error, ExitStatus::file_error);
  } catch (const std::exception& error) {
    end_job(ranks, error, ExitStatus::failed);
  }
}

}  // namespace rubato
