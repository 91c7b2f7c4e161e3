#include "slow_problems.hpp"

#include <fstream>
#include <string>

#include <fmt/format.h>

namespace slow_problems {

void write_lattice(const std::filesystem::path& file, int every) {
  std::string S = "(v^2 - w^2)/2 + u^2/2";
  for (int k = 2; k < 400; ++k) {
    S += fmt::format(" + 1e-7*cos({}*u + {})/{}^4", k, k, k);
  }
  std::ofstream(file) << fmt::format(
      "[multisymplectic]\nfields = [\"u\", \"v\", \"w\"]\nM = [[\"u\", \"v\", -1]]\nK.x = [[\"u\", \"w\", 1]]\n"
      "S = \"{}\"\n[grid]\nx = {{ from = 0, to = \"2*pi\", cells = 21 }}\n[initial]\nu = \"sin(x)\"\n"
      "v = \"-sqrt(2)*cos(x)\"\n[scheme]\nstep = 0.1\nuntil = 1e9\n[output]\nevery = {}\n",
      S, every);
}

void write_orbit(const std::filesystem::path& file, int every) {
  std::string H = "p^2/2 - cos(q)";
  for (int k = 2; k < 150; ++k) {
    H += fmt::format(" - 1e-6*cos({}*q + {})/{}^4", k, k, k);
  }
  std::ofstream(file) << fmt::format(
      "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"{}\"\n[initial]\nq = 0\np = 1.9\n[invariants]\nspeed = \"p^2\"\n"
      "[scheme]\nstep = 0.1\nuntil = 1e9\non_singular = \"stop\"\n[output]\nevery = {}\n",
      H, every);
}

void write_ensemble(const std::filesystem::path& file, int members) {
  std::ofstream(file) << fmt::format(
      "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"p^2/2 - cos(q)\"\n[initial]\nq = 0\np = 1.9\n[scheme]\nstep = "
      "0.1\n"
      "until = 3000\n[output]\ninterval = 500\n[events]\ntop = \"p\"\n[ensemble]\n"
      "random = {{ count = {}, seed = 1, initial.p = \"uniform(0.1, 2.9)\" }}\n",
      members);
}

void write_members_side_by_side(const std::filesystem::path& file, int members) {
  std::ofstream(file) << fmt::format(
      "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"p^2/2 - cos(q)\"\n[initial]\nq = 0\np = 1.9\n[scheme]\nstep = "
      "0.1\nlagrangian = \"splitting\"\nlevels = \"fixed\"\nuntil = 10000\n[events]\nfar = \"q - 500\"\n"
      "[ensemble]\nrandom = {{ count = {}, seed = 1, initial.p = \"uniform(0.1, 2.9)\" }}\n",
      members);
}

}  // namespace slow_problems
