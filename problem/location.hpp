#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace rubato {

/// Where something was written: a place in a problem file, or an option of the command line (then line is 0).
struct Location {
  std::string file;  ///< as the user named it, or "--set scheme.step=0.1"
  int line = 0;      ///< from 1
  int column = 0;    ///< from 1, in characters

  /// "file:line:column", or only "file" when there is no line.
  [[nodiscard]] std::string text() const;
};

/// Something in a problem is wrong. what() is "file:line:column: reason", for formulas with an excerpt and a caret, and
/// says what to do. The program ends with status 2.
class ProblemError : public std::invalid_argument {
public:
  ProblemError(const Location& location, std::string_view reason)
      : std::invalid_argument(location.text() + ": " + std::string(reason)), location_(location) {}
  [[nodiscard]] const Location& location() const { return location_; }
  /// what() without the place.
  [[nodiscard]] std::string_view reason() const {
    return std::string_view(what()).substr(location_.text().size() + std::string_view(": ").size());
  }

private:
  Location location_;
};

/// Calls `make`; what the library refuses is wrong at `location`.
template <typename Make>
auto at_location(const Location& location, const Make& make) {
  try {
    return make();
  } catch (const ProblemError&) {
    throw;
  } catch (const std::invalid_argument& error) {
    throw ProblemError(location, error.what());
  }
}

/// A file could not be read or written. The program ends with status 5.
class FileError : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

}  // namespace rubato
