#include <rubato/report/output_file.hpp>

#include <optional>

#include <rubato/record/detail/failure.hpp>
#include <rubato/record/detail/files.hpp>

namespace rubato::report {

namespace {

namespace files = record::detail;

/// Calls `action`; what fails is about `file`.
template <typename Action>
auto about(const std::filesystem::path& file, const Action& action) {
  try {
    return action();
  } catch (const files::Failure& failure) {
    throw record::Error(file, failure.what());
  }
}

}  // namespace

OutputFile::OutputFile(std::filesystem::path file, bool overwrite) : file_(std::move(file)), overwrite_(overwrite) {
  std::error_code ignored;
  const auto status = std::filesystem::symlink_status(file_, ignored);
  if (std::filesystem::exists(status)) {
    if (!std::filesystem::is_regular_file(file_, ignored)) {
      throw record::Error(file_, "is not a regular file");
    }
    if (!overwrite) {
      throw record::AlreadyExists(file_, "exists already");
    }
  }
  about(file_, [&] {
    files::remove_leftovers(file_);
    next_ = std::make_unique<files::TemporaryFile>(file_, "next");
  });
}

OutputFile::~OutputFile() = default;

void OutputFile::write(std::string_view text) {
  constexpr std::size_t block = std::size_t{1} << 20;
  waiting_ += text;
  if (waiting_.size() >= block) {
    flush();
  }
}

void OutputFile::flush() {
  about(file_, [&] { next_->append(waiting_); });
  waiting_.clear();
}

void OutputFile::finish() {
  using Replace = files::TemporaryFile::Replace;
  flush();
  const bool is_published = about(file_, [&] {
    std::optional<files::Access> access;
    if (overwrite_ && std::filesystem::exists(file_)) {
      access = files::access_of(files::open_regular(file_).number());
    }
    return next_->publish(file_, access ? &*access : nullptr, overwrite_ ? Replace::yes : Replace::no);
  });
  if (!is_published) {
    throw record::AlreadyExists(file_, "exists already");
  }
}

}  // namespace rubato::report
