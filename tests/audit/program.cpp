#include "audit/program.hpp"

#include <cctype>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>

namespace audit {

namespace {

std::string read_text(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

void redirect(int descriptor, const std::filesystem::path& file) {
  const int to = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  ::dup2(to, descriptor);
}

}  // namespace

Call call(const std::string& program, const std::vector<std::string>& arguments, const std::filesystem::path& folder,
          int seconds_allowed) {
  std::vector<std::string> words = arguments;
  words.insert(words.begin(), program);
  std::vector<char*> argv;
  for (std::string& word : words) {
    argv.push_back(word.data());
  }
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    if (::chdir(folder.c_str()) != 0) {
      ::_exit(126);
    }
    redirect(STDOUT_FILENO, folder / ".output");
    redirect(STDERR_FILENO, folder / ".errors");
    ::setenv("OMP_NUM_THREADS", "1", 1);
    ::alarm(static_cast<unsigned>(seconds_allowed));  // outlives execv; SIGALRM ends the program
    ::execv(program.c_str(), argv.data());
    ::_exit(127);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  Call result;
  result.status = WIFSIGNALED(status) ? (WTERMSIG(status) == SIGALRM ? 124 : -WTERMSIG(status)) : WEXITSTATUS(status);
  result.output = read_text(folder / ".output");
  result.errors = read_text(folder / ".errors");
  return result;
}

namespace {

class JsonParser {
public:
  explicit JsonParser(const std::string& text) : text_(text) {}

  Json parse() {
    object("");
    skip();
    if (at_ != text_.size()) {
      fail();
    }
    return std::move(json_);
  }

private:
  [[noreturn]] void fail() const {
    throw std::runtime_error(fmt::format("not one JSON object at byte {}: {}", at_, text_));
  }
  void skip() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) != 0) {
      ++at_;
    }
  }
  bool take(char c) {
    skip();
    if (at_ < text_.size() && text_[at_] == c) {
      ++at_;
      return true;
    }
    return false;
  }
  std::string string() {
    if (!take('"')) {
      fail();
    }
    std::string value;
    while (at_ < text_.size() && text_[at_] != '"') {
      at_ += text_[at_] == '\\' ? 1 : 0;
      value += text_.at(at_++);
    }
    ++at_;
    return value;
  }
  void object(const std::string& prefix) {
    if (!take('{')) {
      fail();
    }
    if (take('}')) {
      return;
    }
    do {
      const std::string key = prefix + string();
      if (!take(':')) {
        fail();
      }
      value(key);
    } while (take(','));
    if (!take('}')) {
      fail();
    }
  }
  void value(const std::string& key) {
    skip();
    if (at_ < text_.size() && text_[at_] == '{') {
      object(key + ".");
    } else if (at_ < text_.size() && text_[at_] == '[') {
      ++at_;
      for (std::size_t i = 0; !take(']'); ++i) {
        value(fmt::format("{}.{}", key, i));
        take(',');
      }
    } else if (at_ < text_.size() && text_[at_] == '"') {
      json_.texts[key] = string();
    } else {
      const std::size_t end = std::min(text_.find_first_of(",}] \n", at_), text_.size());
      const std::string word = text_.substr(at_, end - at_);
      at_ = end;
      json_.texts[key] = word;
      if (word == "true" || word == "false" || word == "null") {
        return;
      }
      char* rest = nullptr;
      json_.numbers[key] = std::strtod(word.c_str(), &rest);
      if (word.empty() || *rest != '\0') {
        fail();
      }
    }
  }

  const std::string& text_;
  std::size_t at_ = 0;
  Json json_;
};

}  // namespace

Json parse_json(const std::string& text) {
  return JsonParser(text).parse();
}

Folder::Folder() {
  std::string name = (std::filesystem::temp_directory_path() / "rubato-audit-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) {
    throw std::runtime_error("no temporary folder");
  }
  path_ = name;
}

Folder::~Folder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

}  // namespace audit
