#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

/// Records as `rubato run` writes them, but with numbers that need no integration: the tests of reports, exports and
/// comparisons look at these.
namespace sample {

struct OrbitRecord {
  std::size_t steps = 500;
  std::size_t dimension = 1;  ///< coordinates q1, q2, …
  std::string title = "An orbit";
  std::string problem = "title = \"An orbit\"\n";
  double frequency = 1.0;
  bool with_exact = true;
  bool with_off_law = true;
  std::size_t spike = 0;                ///< number of a level at which H jumps by 1, if not 0
  std::vector<std::string> names = {};  ///< of the coordinates, if not q1, q2, …
  double size = 1.0;                    ///< of the coordinates
  std::size_t crossings = 0;            ///< of [section], if not 0, at each level that many
};
void write_orbit(const std::filesystem::path& file, const OrbitRecord& orbit);

struct LatticeRecord {
  std::size_t levels = 60;
  std::size_t nx = 101, ny = 1, nz = 1;  ///< a line, a plane or a volume: as many axes as there are sizes above 1
  std::string title = "A lattice";
  std::string field = "u";
  std::size_t spike_level = 0, spike_cell = 0;  ///< where the field is 100, if the level is not 0
  std::string other_field = "";                 ///< a field more, without an exact solution
  std::size_t undefined_every = 0;              ///< levels at which one residual and the momentum have no value
  double residual = 1e-6;                       ///< size of the local residual
  bool walls = false;                           ///< a cell less than nodes in each direction, where the residual is
};
void write_lattice(const std::filesystem::path& file, const LatticeRecord& lattice);

}  // namespace sample
