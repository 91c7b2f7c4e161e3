#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "comparison.hpp"

namespace comparison {

using rubato::LatticeIntegrator;
using rubato::LatticeOptions;
using rubato::Levels;
using rubato::Status;

namespace {

constexpr double none = std::numeric_limits<double>::infinity();

}  // namespace

rubato::grids::Grid Problem::grid(std::size_t nodes) const {
  return rubato::grids::Grid({{"x", from, from + length, nodes}});
}

rubato::InitialFields Problem::initial(std::size_t nodes) const {
  rubato::InitialFields result;
  for (const int which : given) {
    if (which == 0) {
      result.emplace_back(std::nullopt);
      continue;
    }
    std::vector<double> values(nodes);
    for (std::size_t i = 0; i < nodes; ++i) {
      values[i] = (which == 1 ? first : second)(line(nodes).node(i));
    }
    result.emplace_back(std::move(values));
  }
  return result;
}

Reference::Reference(const Problem& problem) : problem_(problem), peer_(problem.converged(problem.converged_nodes)) {
  peer_->stand(problem.first, problem.second);
  peer_->go(problem.until, problem.converged_steps);
  end_ = peer_->state();
  series_ = peer_->solution();
  const std::size_t fewer = problem.converged_nodes * 3 / 4;
  const auto rough = problem.converged(fewer);
  rough->stand(problem.first, problem.second);
  rough->go(problem.until, problem.converged_steps / 2);
  uncertainty_ = error(rough->solution(), fewer);
}

double Reference::error(const peers::Series& series, std::size_t nodes) const {
  const peers::Line line = problem_.line(nodes);
  double largest = 0.0;
  for (std::size_t i = 0; i < nodes; ++i) {
    const double difference = std::abs(series(line.node(i)) - series_(line.node(i)));
    largest = difference <= largest || std::isnan(largest) ? largest : difference;
  }
  return std::isfinite(largest) ? largest / problem_.scale : none;
}

double Reference::error(const std::vector<std::vector<double>>& fields, double t) const {
  peers::Series there = series_;
  const double later = t - problem_.until;
  if (std::abs(later) > 1e-14 * problem_.until) {
    peer_->stand(end_);
    peer_->go(later, std::max(8, static_cast<int>(problem_.converged_steps * std::abs(later) / problem_.until)));
    there = peer_->solution();
  }
  const std::size_t nodes = fields.front().size();
  double largest = 0.0;
  for (std::size_t i = 0; i < nodes; ++i) {
    const peers::Complex exact = there(problem_.line(nodes).node(i));
    const double imaginary = fields.size() > 1 ? fields[1][i] - exact.imag() : 0.0;
    const double difference = std::hypot(fields[0][i] - exact.real(), imaginary);
    largest = difference <= largest || std::isnan(largest) ? largest : difference;
  }
  return std::isfinite(largest) ? largest / problem_.scale : none;
}

Method peer_method(const Problem& problem, const Reference& reference, std::string name,
                   std::unique_ptr<peers::Peer> peer, std::size_t nodes, int first) {
  const std::shared_ptr<peers::Peer> own = std::move(peer);
  own->stand(problem.first, problem.second);
  return {std::move(name), Class::peer, nodes, first,
          [&problem, &reference, own, nodes, start = own->state()](int steps, bool timed_only) {
            own->stand(start);
            const double seconds = own->go(problem.until, steps);
            return Outcome{{timed_only ? 0.0 : reference.error(own->solution(), nodes)}, seconds};
          }};
}

Method our_method(const Problem& problem, const Reference& reference, LatticeOptions options, Class kind,
                  std::size_t nodes, int first) {
  const std::string name =
      options.lagrangian == "splitting" ? options.composition : "Gauss " + std::to_string(options.stages);
  options.levels = kind == Class::with_levels ? Levels::variable : Levels::fixed;
  return {name, kind, nodes, first, [&problem, &reference, options, kind, nodes](int steps, bool timed_only) {
            LatticeOptions own = options;
            own.until = problem.until;
            own.step = problem.until / steps;
            LatticeIntegrator lattice(problem.system, problem.grid(nodes), problem.initial(nodes), own);
            Outcome outcome;
            int taken = 0;
            const double start = peers::cpu_seconds();
            while (!lattice.finished()) {
              const double begin = taken == 0 ? start : 0.0;
              if (lattice.step().status != Status::success || ++taken > 20 * steps) {
                return Outcome{{none}, none};
              }
              if (taken == 1) {
                outcome.before = peers::cpu_seconds() - begin;
              }
              if (kind == Class::with_laws) {
                static_cast<void>(lattice.residuals());
              }
            }
            outcome.seconds = peers::cpu_seconds() - start;
            if (timed_only) {
              return outcome;
            }
            std::vector<std::vector<double>> fields;
            for (const int f : problem.fields) {
              const auto values = lattice.field(f);
              fields.emplace_back(values.begin(), values.end());
            }
            outcome.errors = {reference.error(fields, lattice.t())};
            return outcome;
          }};
}

void add_ours(const Problem& problem, const Reference& reference, const std::vector<LatticeOptions>& options,
              const std::vector<std::size_t>& nodes, int first, std::vector<Method>& methods) {
  for (const LatticeOptions& one : options) {
    for (const std::size_t n : nodes) {
      for (const Class kind : {Class::ours, Class::with_laws, Class::with_levels}) {
        methods.push_back(our_method(problem, reference, one, kind, n, first));
      }
    }
  }
}

LatticeOptions splitting(const std::string& composition) {
  LatticeOptions options;
  options.lagrangian = "splitting";
  options.composition = composition;
  return options;
}

LatticeOptions gauss(int stages) {
  LatticeOptions options;
  options.lagrangian = "fourier";
  options.stages = stages;
  return options;
}

Eigen::MatrixXd skew(int size, std::initializer_list<std::tuple<int, int, double>> entries) {
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size, size);
  for (const auto& [row, column, value] : entries) {
    matrix(row, column) = value;
    matrix(column, row) = -value;
  }
  return matrix;
}

void report(const Problem& problem, const Reference& reference, const std::vector<Method>& methods, int repeats) {
  char title[160];
  std::snprintf(title, sizeof title, "%s to t = %g; the solution compared with is known to %.1e", problem.name.c_str(),
                problem.until, reference.uncertainty());
  report(Study{.title = title, .measures = {"field"}, .targets = {1e-2, 1e-4, 1e-6, 1e-9}}, methods, repeats);
}

}  // namespace comparison
