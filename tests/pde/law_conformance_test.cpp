// What every local law has to do, for all that the schemes of the registry have of systems with every kind of them:
// energy, momenta, linear symmetries, affine ones, and the balances of a medium that varies.

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/lattice_method.hpp>

#include "mesh_cases.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::FieldSet;

namespace {

/// A system with the laws that it should have, whatever the scheme.
struct Lawful {
  MeshCase problem;
  std::vector<LinearSymmetry> symmetries;
  std::vector<std::string> laws;
};

std::vector<Lawful> lawful_systems() {
  LinearSymmetry charge{"charge", Eigen::MatrixXd::Zero(4, 4)};
  charge.B(0, 1) = -1.0;
  charge.B(1, 0) = 1.0;
  charge.B(2, 3) = -1.0;
  charge.B(3, 2) = 1.0;
  const grids::Grid line({{"x", 0, 2, 9}});
  const grids::Grid plane({{"x", 0, 2, 5}, {"y", -1, 1, 7}});
  return {
      {{sine_gordon(), line}, {}, {"energy", "momentum"}},
      {{wave_equation("(1 + 0.4*sin(pi*x))*(1 - cos(u))"), line}, {}, {"energy", "momentum_balance"}},
      {{schroedinger(2), line}, {charge}, {"energy", "momentum", "charge"}},
      {{korteweg_de_vries(6, 1), line}, {}, {"energy", "momentum", "mass"}},
      {{wave_equation_2d("1 - cos(u) + 0.3*sin(pi*y)*u"), plane}, {}, {"energy", "momentum_x", "momentum_balance_y"}},
  };
}

/// Calls f(name, laws, system, order) for every scheme that takes the system, in one and in two stages.
template <typename F>
void for_each_scheme(const Lawful& lawful, F&& f) {
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    for (const int stages : {1, 2}) {
      if (stages > 1 && !entry.has_stages) {
        continue;
      }
      try {
        const auto method = make_lattice_method({.name = std::string(entry.name), .stages = stages});
        const MultisymplecticSystem system = method->seen(lawful.problem.system);
        // Whether it takes the system is said by its equation.
        static_cast<void>(method->equation(system, lawful.problem.grid,
                                           {random_fields(system.field_count(), lawful.problem.grid.size(), 1), {}},
                                           0.0));
        LocalLaws laws = make_local_laws(*method, system, lawful.problem.grid, lawful.symmetries);
        INFO(entry.name << ", stages " << stages << ", of " << system.fields().front() << ", " << system.field_count()
                        << " fields");
        f(laws, system);
      } catch (const std::invalid_argument&) {
        continue;
      }
    }
  }
}

LatticeLevel level_of(const MultisymplecticSystem& system, const grids::Grid& grid, unsigned seed) {
  LatticeLevel level{random_fields(system.field_count(), grid.size(), seed), {}};
  for (double& value : level.fields.all()) {
    value *= 0.3;  // so that steps of families are solved from there
  }
  return level;
}

constexpr double step = 0.02;

}  // namespace

TEST_CASE("every scheme has the laws that the system has") {
  for (const Lawful& lawful : lawful_systems()) {
    int schemes = 0;
    for_each_scheme(lawful, [&](LocalLaws& laws, const MultisymplecticSystem&) {
      CHECK(laws.names() == lawful.laws);
      ++schemes;
    });
    CHECK(schemes >= 4);
  }
}

TEST_CASE("every local law is told of cells and of their sizes alike, from two levels alone") {
  for (const Lawful& lawful : lawful_systems()) {
    const grids::Grid& grid = lawful.problem.grid;
    for_each_scheme(lawful, [&](LocalLaws& laws, const MultisymplecticSystem& system) {
      const LatticeLevel before = level_of(system, grid, 3), after = level_of(system, grid, 4);
      FieldSet cells(static_cast<int>(laws.count()), grid.size()), again(cells), other(cells);
      const auto sizes = laws.residuals(before, after, step, cells.pointers());
      static_cast<void>(laws.residuals(after, before, step, other.pointers()));
      static_cast<void>(laws.residuals(before, after, step, again.pointers()));
      REQUIRE(sizes.size() == laws.count());
      CHECK(largest_difference(cells.all(), again.all()) == 0.0);
      for (std::size_t law = 0; law < laws.count(); ++law) {
        INFO(laws.names()[law]);
        const Spread reported = grids::magnitudes(std::as_const(cells).field(static_cast<int>(law)));
        CHECK(sizes[law].largest() == reported.largest());
        CHECK(sizes[law].rms() == Approx(reported.rms()).epsilon(1e-14));
        CHECK(sizes[law].count() == static_cast<double>(grid.size()));
        CHECK(largest_difference(cells.field(static_cast<int>(law)), other.field(static_cast<int>(law))) > 1e-6);
      }
    });
  }
}

TEST_CASE("what laws know of a level from the step that led to it changes nothing") {
  int told_wrongly = 0;
  for (const Lawful& lawful : lawful_systems()) {
    const grids::Grid& grid = lawful.problem.grid;
    for_each_scheme(lawful, [&](LocalLaws& laws, const MultisymplecticSystem& system) {
      const LatticeLevel first = level_of(system, grid, 3), second = level_of(system, grid, 4),
                         third = level_of(system, grid, 5);
      FieldSet plain(static_cast<int>(laws.count()), grid.size()), next(plain);
      const auto residuals = [&](const LatticeLevel& before, const LatticeLevel& after, FieldSet& cells,
                                 LocalLaws::Question earlier) {
        static_cast<void>(laws.residuals(before, after, step, cells.pointers(), earlier));
        return laws.last_question();
      };
      static_cast<void>(residuals(second, third, plain, LocalLaws::none));
      const auto totals = laws.totals(third);
      const auto question = residuals(first, second, next, LocalLaws::none);
      CHECK(question != LocalLaws::none);
      static_cast<void>(laws.totals_after(second));  // which leaves what is known
      const auto following = residuals(second, third, next, question);
      CHECK(std::ranges::equal(next.all(), plain.all()));
      CHECK(laws.totals_after(third) == totals);
      // Something else was asked for since: what is known is of that, and is not taken.
      static_cast<void>(laws.totals(first));
      static_cast<void>(residuals(second, third, next, following));
      CHECK(std::ranges::equal(next.all(), plain.all()));
      static_cast<void>(residuals(first, second, next, LocalLaws::none));
      static_cast<void>(residuals(second, third, next, question));
      CHECK(std::ranges::equal(next.all(), plain.all()));
      // The twin: a step that does not follow, said to, of laws that keep something.
      static_cast<void>(residuals(second, third, next, residuals(second, first, next, LocalLaws::none)));
      told_wrongly += std::ranges::equal(next.all(), plain.all()) ? 0 : 1;
    });
  }
  CHECK(told_wrongly >= 4);
}

TEST_CASE("every local law adds up to the rate of its total, on any levels: fluxes leave nothing on a ring") {
  for (const Lawful& lawful : lawful_systems()) {
    const grids::Grid& grid = lawful.problem.grid;
    for_each_scheme(lawful, [&](LocalLaws& laws, const MultisymplecticSystem& system) {
      const LatticeLevel before = level_of(system, grid, 5), after = level_of(system, grid, 6);
      FieldSet cells(static_cast<int>(laws.count()), grid.size());
      static_cast<void>(laws.residuals(before, after, step, cells.pointers()));
      const auto from = laws.totals(before), to = laws.totals(after);
      for (std::size_t law = 0; law < laws.count(); ++law) {
        INFO(laws.names()[law]);
        const double sum = grid.cell_volume() * grids::sum(std::as_const(cells).field(static_cast<int>(law)));
        const double rate = (to[law] - from[law]) / step;
        const bool has_source = laws.names()[law].find("balance") != std::string::npos;
        // Densities and fluxes of order 1 to 100, over h and Δx, a few dozen cells: to units in the last place.
        const double rounding = 1e-12 * (1.0 + std::abs(rate) + grids::max_abs(cells.field(static_cast<int>(law))));
        CHECK((std::abs(sum - rate) < rounding) == !has_source);  // the balance is the twin
      }
    });
  }
}

TEST_CASE("every local law is smaller on the steps of its scheme than on others") {
  for (const Lawful& lawful : lawful_systems()) {
    const grids::Grid line({{"x", -8, 8, 45}});
    if (lawful.problem.grid.dimensions() > 1) {
      continue;
    }
    const MultisymplecticSystem& given = lawful.problem.system;
    for (const LatticeMethodEntry& entry : lattice_methods()) {
      const auto method = make_lattice_method({.name = std::string(entry.name)});
      const MultisymplecticSystem system = method->seen(given);
      INFO(entry.name << " of " << system.fields().front() << ", " << system.field_count() << " fields");
      std::unique_ptr<LatticeScheme> scheme;
      const double h = 0.02;
      try {
        InitialFields initial(static_cast<std::size_t>(system.field_count()));
        const auto hump = [](double x) { return std::exp(2 * std::cos(M_PI * (x - 1) / 8) - 2); };
        for (int f = 0; f < system.field_count(); ++f) {
          const bool moves =
              !system.M().row(f).isZero(0.0) && !system.structure().potential[static_cast<std::size_t>(f)];
          if (moves) {
            initial[static_cast<std::size_t>(f)] = sampled(line, [&](double x) { return hump(x + 0.5 * f); });
          }
        }
        scheme = method->scheme(system, line, method->first_level(system, line, initial).level, h);
      } catch (const std::invalid_argument&) {
        continue;
      }
      LocalLaws laws = make_local_laws(*method, system, line, lawful.symmetries);
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      scheme->accept();
      const LatticeLevel before = scheme->level();
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      scheme->accept();
      LatticeLevel after = scheme->level();
      const auto sound = laws.residuals(before, after, h);
      for (int f = 0; f < system.field_count(); ++f) {
        for (std::size_t i = 0; i < line.size(); ++i) {
          after.fields.field(f)[i] += 0.05 * std::sin(0.3 + static_cast<double>(i * (f + 1)));
        }
      }
      const auto spoilt = laws.residuals(before, after, h);
      for (std::size_t law = 0; law < laws.count(); ++law) {
        INFO(laws.names()[law]);
        CHECK(std::isfinite(sound[law].largest()));
        CHECK(spoilt[law].largest() > 2.0 * sound[law].largest());
      }
    }
  }
}
