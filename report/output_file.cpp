#include <rubato/report/output_file.hpp>

#include <unistd.h>

#include <cerrno>
#include <system_error>

#include <fmt/format.h>

namespace rubato::report {

namespace {

std::string last_error() {
  return std::error_code(errno, std::generic_category()).message();
}

}  // namespace

OutputFile::OutputFile(std::filesystem::path file, bool overwrite)
    : file_(std::move(file)), next_(fmt::format("{}.{}.next", file_.string(), ::getpid())) {
  if (!overwrite && std::filesystem::exists(file_)) {
    throw record::AlreadyExists(file_, "exists already");
  }
  stream_.open(next_, std::ios::binary);
  if (!stream_) {
    throw record::Error(file_, last_error());
  }
}

OutputFile::~OutputFile() {
  if (!is_finished_) {
    stream_.close();
    std::error_code ignored;
    std::filesystem::remove(next_, ignored);
  }
}

void OutputFile::write(std::string_view text) {
  if (!stream_.write(text.data(), static_cast<std::streamsize>(text.size()))) {
    throw record::Error(file_, last_error());
  }
}

void OutputFile::finish() {
  stream_.close();
  if (!stream_) {
    throw record::Error(file_, last_error());
  }
  std::error_code error;
  std::filesystem::rename(next_, file_, error);
  if (error) {
    throw record::Error(file_, error.message());
  }
  is_finished_ = true;
}

}  // namespace rubato::report
