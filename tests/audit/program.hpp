#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace audit {

/// What a call of the program left behind.
struct Call {
  int status = 0;  ///< of its exit; minus the signal that ended it; 124 if it was stopped after the time allowed
  std::string output, errors;
};

/// Runs the program in a folder, as a user does.
Call call(const std::string& program, const std::vector<std::string>& arguments, const std::filesystem::path& folder,
          int seconds_allowed = 120);

/// One JSON object, flattened: the number under "gamma": {"min": … is called gamma.min.
struct Json {
  std::map<std::string, double> numbers;
  std::map<std::string, std::string> texts;  ///< of the numbers, too, as they were printed

  [[nodiscard]] bool has(const std::string& key) const { return numbers.contains(key); }
  /// Throws if it is absent.
  [[nodiscard]] double operator[](const std::string& key) const { return numbers.at(key); }
};

/// Throws std::runtime_error where the text is anything but one object.
Json parse_json(const std::string& text);

/// A folder of its own, removed afterwards.
class Folder {
public:
  Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder();
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
  std::filesystem::path path_;
};

void write_text(const std::filesystem::path& file, const std::string& text);

}  // namespace audit
