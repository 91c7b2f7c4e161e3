#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <rubato/record/detail/hdf5.hpp>
#include <rubato/record/layout.hpp>

namespace rubato::record::detail {

inline constexpr const char* format_name = "rubato-1";

/// Name of the attribute of every growing dataset that says how many rows are published.
inline constexpr const char* rows_attribute = "rows";

/// Name of the attribute of the root with the paths of all datasets that a record was made with, one a line: what it
/// promises. Records of earlier versions have none, and may lack datasets that are written today.
inline constexpr const char* contents_attribute = "contents";

/// Throws std::invalid_argument if the layout contradicts itself.
void validate(const Layout& layout);

/// The sizes of one row's dimensions, slowest first.
[[nodiscard]] std::vector<hsize_t> row_shape(const Layout& layout, const Dataset& dataset);

/// Sizes of the chunks of a new dataset, rows first: about 128 KiB of whole rows, at most 16384 of them; where fewer
/// are expected that many, but 4 KiB at least, for a run that goes on longer. A row of more than 1 MiB (the size of
/// HDF5's chunk cache) is divided along its slowest dimensions.
[[nodiscard]] std::vector<hsize_t> chunk_shape(const Layout& layout, const Dataset& dataset);

/// The sizes of the chunks of a dataset, rows first. Throws Failure if it is not stored in chunks.
[[nodiscard]] std::vector<hsize_t> chunk_of(hid_t dataset);

/// True if ranks can write its rows together, by how it was made (record/together.hpp).
[[nodiscard]] bool is_for_ranks(hid_t dataset);

/// The links (name, target) that put a dataset's axis and scales into its own group.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> links_of(const Dataset& dataset);

/// Makes the groups, the scales with their values, the datasets without rows, and the attributes.
void create_structure(hid_t file, const Layout& layout);

/// Throws Failure unless every dataset is there that the record promises.
void check_contents(hid_t file);

/// Throws Failure unless the file has the scales (with equal values) and exactly the growing datasets of the layout.
void compare_structure(hid_t file, const Layout& layout);

/// Title, problem, version, compiler, threads.
void write_root_attributes(hid_t file, const Layout& layout);

/// Throws Failure unless the file says that it is a record of a format that is known here.
void check_format(hid_t file);

/// Paths of all datasets in alphabetical order, hard links included.
[[nodiscard]] std::vector<std::string> dataset_paths(hid_t file);

[[nodiscard]] std::vector<std::string> read_texts(hid_t dataset);

}  // namespace rubato::record::detail
