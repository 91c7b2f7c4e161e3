#pragma once

#include <cstddef>
#include <span>
#include <stdexcept>
#include <vector>

namespace rubato {

/// The part of an object's state that a run needs to be continued bit for bit, as a flat list of doubles: what
/// `save(StateWriter&)` writes, `restore(StateReader&)` reads back in the same order.
class StateWriter {
public:
  /// Who reads it: whoever opens a record; or this process, which goes back to where it was. What several ranks share
  /// is gathered for a record, and each keeps its part to go back to.
  enum class For { record, going_back };
  explicit StateWriter(For reader = For::record) : reader_(reader) {}
  [[nodiscard]] For reader() const { return reader_; }

  void write(double value) { values_.push_back(value); }
  void write(std::span<const double> values) { values_.insert(values_.end(), values.begin(), values.end()); }
  /// What this process has of `of` values.
  void write_part(std::span<const double> values, std::size_t of) {
    write(values);
    size_ += of - values.size();
  }
  [[nodiscard]] const std::vector<double>& values() const { return values_; }
  /// How many values there are, of all ranks together.
  [[nodiscard]] std::size_t size() const { return values_.size() + size_; }
  void clear() { *this = StateWriter(reader_); }

private:
  For reader_;
  std::vector<double> values_;
  std::size_t size_ = 0;  ///< of the parts of others
};

class StateReader {
public:
  explicit StateReader(std::span<const double> values) : rest_(values) {}
  explicit StateReader(const StateWriter& writer) : rest_(writer.values()), reader_(writer.reader()) {}
  [[nodiscard]] StateWriter::For reader() const { return reader_; }

  double read() {
    double value = 0.0;
    read({&value, 1});
    return value;
  }
  template <typename T>
  void read(T& value) {
    value = static_cast<T>(read());
  }
  /// \throws std::invalid_argument if fewer values are left than asked for
  void read(std::span<double> values) {
    if (values.size() > rest_.size()) {
      throw std::invalid_argument("a saved state is shorter than the object it should restore");
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = rest_[i];
    }
    rest_ = rest_.subspan(values.size());
  }
  [[nodiscard]] bool done() const { return rest_.empty(); }

private:
  std::span<const double> rest_;
  StateWriter::For reader_ = StateWriter::For::record;
};

}  // namespace rubato
