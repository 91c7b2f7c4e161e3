#pragma once

#include <span>
#include <stdexcept>
#include <vector>

namespace rubato {

/// The part of an object's state that a run needs to be continued bit for bit, as a flat list of doubles: what
/// `save(StateWriter&)` writes, `restore(StateReader&)` reads back in the same order.
class StateWriter {
public:
  void write(double value) { values_.push_back(value); }
  void write(std::span<const double> values) { values_.insert(values_.end(), values.begin(), values.end()); }
  [[nodiscard]] const std::vector<double>& values() const { return values_; }
  void clear() { values_.clear(); }

private:
  std::vector<double> values_;
};

class StateReader {
public:
  explicit StateReader(std::span<const double> values) : rest_(values) {}

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
};

}  // namespace rubato
