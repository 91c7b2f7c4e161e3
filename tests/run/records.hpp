#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/run.hpp>

#include "../folder.hpp"

namespace rubato::run_tests {

using tests::Folder;

rubato::Outcome run_problem(const std::string& name, const std::string& file,
                            const std::vector<std::string>& settings = {}, bool tangents = false);

/// Starts the ensemble (or resumes its record) and interrupts it once it has finished so many more members: one thread
/// stops there, of several each goes on with the member it has.
rubato::EnsembleOutcome interrupt_after(std::size_t count, const rubato::Problem& problem, const std::string& file,
                                        bool start, int threads);

using Names = std::vector<std::string>;

/// What differs in the tables of a run and of its check, or of another run, by name: every figure is the same number.
Names differences(const rubato::Outcome& run, const rubato::Outcome& check);

/// The same for two numbers of ranks, whose sums agree to rounding.
Names differences_on_ranks(const rubato::Outcome& one, const rubato::Outcome& other);

/// The datasets of two records that are not the same bit by bit, by path.
Names different_datasets(const std::string& a, const std::string& b);
/// The datasets of two records that do not agree to rounding, by path. Not of the checkpoint, which has digests, and
/// measures of waves that a shared lattice does not have.
Names different_on_ranks(const std::string& a, const std::string& b);

/// The largest difference of two fields of as many numbers.
double largest_distance(const std::vector<double>& a, const std::vector<double>& b);
/// The last row of a dataset.
std::vector<double> last_row(const rubato::record::Reader& reader, const std::string& path);

/// Adds `change` to one number of a record.
void falsify(const std::string& file, const std::string& dataset, std::size_t index, double change);

/// Puts another text in an attribute of an open file (hid_t).
void write_text(std::int64_t file, const char* attribute, const char* text);
/// Makes a record that of another problem.
void replace_problem(const std::string& file, const std::string& text);

}  // namespace rubato::run_tests
