#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include <rubato/record/error.hpp>

namespace rubato::record::detail {
class TemporaryFile;
}

namespace rubato::report {

/// A file that appears whole or not at all: it is written under another name beside its place, and renamed by
/// finish(). Without that it leaves nothing. What stands in its place is replaced with leave only, and only if it is a
/// regular file, whose permissions stay. \throws record::AlreadyExists, record::Error
class OutputFile {
public:
  OutputFile(std::filesystem::path file, bool overwrite);
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  ~OutputFile();

  void write(std::string_view text);
  void finish();

private:
  void flush();

  std::filesystem::path file_;
  bool overwrite_;
  std::unique_ptr<record::detail::TemporaryFile> next_;
  std::string waiting_;
};

}  // namespace rubato::report
