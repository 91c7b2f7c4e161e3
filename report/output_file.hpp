#pragma once

#include <filesystem>
#include <fstream>
#include <string_view>

#include <rubato/record/error.hpp>

namespace rubato::report {

/// A file that appears whole or not at all: it is written under another name beside its place, and renamed by
/// finish(). Without that it leaves nothing. \throws record::AlreadyExists, record::Error
class OutputFile {
public:
  OutputFile(std::filesystem::path file, bool overwrite);
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  ~OutputFile();

  void write(std::string_view text);
  void finish();

private:
  std::filesystem::path file_, next_;
  std::ofstream stream_;
  bool is_finished_ = false;
};

}  // namespace rubato::report
