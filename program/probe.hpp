#pragma once

#include <filesystem>

namespace rubato::program {

/// Reads a record's structure in a process of its own, before it is read here: on some damaged files the HDF5 library
/// itself crashes, or never comes to an end. \throws record::Error if it does
void probe_record(const std::filesystem::path& file);

}  // namespace rubato::program
