#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/jumps.hpp>
#include <rubato/problem/document.hpp>
#include <rubato/problem/problem.hpp>

/// [initial] from = "old.h5": a stored state of another run as the start.
namespace rubato {

/// What is called with a file of [initial] from before it is opened; none unless it is set. Damage may crash the HDF5
/// library: the program tries the file in a process of its own. It throws record::Error for a file that is not to be
/// opened.
void probe_sources_with(void (*probe)(const std::filesystem::path& file));

/// Resolves [initial] from in a problem's tree, so that its record does not depend on the other one. Of an orbit the
/// numbers themselves take its place. Of a lattice `at`, the time of the stored level nearest to the one asked for,
/// `t`, the start, and `take`, the names of the fields that the other problem gave itself, are filled in where they are
/// missing; the values are then found in the first state of the new record.
/// \return whether there was anything to resolve
/// \throws ProblemError at the place in [initial], also if the other record cannot be read
[[nodiscard]] bool resolve_initial_record(Value& root);

/// The fields of `source.take` at the nodes of `grid`, interpolated by waves where the other grid has other cells.
/// \param names of all fields \param jumps those of fields that arrays and tables give; a record has its own
/// \throws ProblemError at the place in [initial]
[[nodiscard]] std::vector<std::vector<double>> read_initial_fields(const InitialRecord& source, const grids::Grid& grid,
                                                                   std::span<const std::string> names,
                                                                   const Jumps& jumps);

}  // namespace rubato
