#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/run/run.hpp>

namespace rubato::run_tests {

/// A folder of its own for one test, removed afterwards.
class Folder {
public:
  Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() { std::filesystem::remove_all(path_); }
  [[nodiscard]] std::string operator/(const std::string& name) const { return (path_ / name).string(); }

private:
  std::filesystem::path path_;
};

rubato::Outcome run_problem(const std::string& name, const std::string& file,
                            const std::vector<std::string>& settings = {}, bool tangents = false);

using Names = std::vector<std::string>;

/// What differs in the tables of a run and of its check, or of another run, by name: every figure is the same number.
Names differences(const rubato::Outcome& run, const rubato::Outcome& check);

/// The datasets of two records that are not the same bit by bit, by path.
Names different_datasets(const std::string& a, const std::string& b);

/// Adds `change` to one number of a record.
void falsify(const std::string& file, const std::string& dataset, std::size_t index, double change);

/// Puts another text in an attribute of an open file (hid_t).
void write_text(std::int64_t file, const char* attribute, const char* text);
/// Makes a record that of another problem.
void replace_problem(const std::string& file, const std::string& text);

}  // namespace rubato::run_tests
