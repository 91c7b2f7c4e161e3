// What the catalogue's problems evaluate in their steps: machine code and the interpreter agree to the bit.

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/problem/browse.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/problem.hpp>

#include "formula/engines.hpp"

using namespace rubato;
using namespace rubato;

namespace {

/// Orbits' states are of about the size of 1, and away from collisions.
std::vector<std::vector<double>> states(std::size_t size) {
  std::mt19937_64 random(size);
  std::normal_distribution<double> normal;
  std::vector<std::vector<double>> points(50, std::vector<double>(size));
  for (auto& point : points) {
    for (double& x : point) {
      x = normal(random);
    }
  }
  return points;
}

}  // namespace

TEST_CASE("gradients and Hessians of every problem of the catalogue, in machine code and interpreted") {
  std::size_t problems = 0, twins_seen = 0, twins = 0;
  for (const CatalogueItem& item : list_catalogue()) {
    INFO(item.name);
    const Problem problem = read_problem(item.name);
    const auto compare = [&](const formula::Bytecode& code) {
      const std::vector<std::vector<double>> points = states(code.input_count());
      CHECK(formula::testing::disagreements(code, code, points) == 0);
      CHECK(formula::testing::batch_disagreements(code, code, points) == 0);
    };
    if (item.is_lattice) {
      const MultisymplecticSystem system = make_system(problem);
      compare(system.value_code());
      compare(system.gradient_code());
      compare(system.hessian_code());
    } else if (!problem.hamiltonian()->L) {
      const Hamiltonian hamiltonian = make_hamiltonian(problem);
      compare(hamiltonian.value_code());
      compare(hamiltonian.gradient_code());
      compare(hamiltonian.hessian_code());
      // The twin: coordinates and momenta change places, which most Hamiltonians notice.
      std::vector<formula::Expression> swapped(hamiltonian.variables().rbegin(), hamiltonian.variables().rend());
      const formula::Bytecode other(std::array{hamiltonian.expression()}, swapped);
      ++twins;
      twins_seen +=
          formula::testing::disagreements(other, hamiltonian.value_code(), states(swapped.size())) > 0 ? 1 : 0;
    }
    ++problems;
  }
  CHECK(problems > 30);
  CHECK(2 * twins_seen > twins);
}
