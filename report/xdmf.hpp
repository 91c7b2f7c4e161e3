#pragma once

#include <filesystem>

#include <rubato/record/reader.hpp>

namespace rubato::report {

/// Writes an XDMF file that shows ParaView and its kin where in the record the fields of a lattice lie (no numbers are
/// copied, so the two files stay together): one grid in time for the fields and exact solutions, at the nodes, and one
/// for the residuals of the local laws, at the points they belong to. The record is named relative to the XDMF file.
/// An existing file is replaced only if `overwrite` or if it was written for this very record.
/// \throws std::invalid_argument if the record holds an orbit; record::AlreadyExists, record::Error
void export_xdmf(const record::Reader& reader, const std::filesystem::path& file, bool overwrite = false);

}  // namespace rubato::report
