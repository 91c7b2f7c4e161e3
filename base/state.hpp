#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

namespace rubato {

/// The part of an object's state that a run needs to be continued bit for bit, as a flat list of doubles: what
/// `save(StateWriter&)` writes, `restore(StateReader&)` reads back in the same order.
class StateWriter {
public:
  /// Who reads it: the caller that opens a record; or this process, which goes back to where it was. What several ranks
  /// share is gathered for a record, and each keeps its part to go back to.
  enum class For { record, going_back };
  using Take = std::function<void(std::span<const double>)>;
  explicit StateWriter(For reader = For::record) : reader_(reader) {}
  /// Hands over what is written, piece by piece, and keeps none of it; only counts it with no `take`.
  StateWriter(For reader, Take take) : reader_(reader), keeps_(false), take_(std::move(take)) {}
  [[nodiscard]] For reader() const { return reader_; }

  void write(double value) { write(std::span<const double>(&value, 1)); }
  void write(std::span<const double> values) {
    size_ += values.size();
    if (keeps_) {
      values_.insert(values_.end(), values.begin(), values.end());
    } else if (take_) {
      take_(values);
    }
  }
  /// What this process has of `of` values.
  void write_part(std::span<const double> values, std::size_t of) {
    write(values);
    size_ += of - values.size();
  }
  [[nodiscard]] const std::vector<double>& values() const { return values_; }
  /// How many values there are, of all ranks together.
  [[nodiscard]] std::size_t size() const { return size_; }
  void clear() { *this = StateWriter(reader_); }

private:
  For reader_;
  bool keeps_ = true;
  Take take_;
  std::vector<double> values_;
  std::size_t size_ = 0;
};

/// Where a state comes from that several ranks restore together, in the order in which it was written. All ranks call
/// the same.
class StateSource {
public:
  virtual ~StateSource() = default;
  /// The next values, for all ranks.
  virtual void read(std::span<double> values) = 0;
  /// The next values, for the rank that has the source; others pass over them.
  virtual void read_alone(std::span<double> values) = 0;
};

class StateReader {
public:
  explicit StateReader(std::span<const double> values) : rest_(values), left_(values.size()) {}
  explicit StateReader(const StateWriter& writer) : StateReader(std::span<const double>(writer.values())) {
    reader_ = writer.reader();
  }
  /// `size` values of a source, which has to live longer.
  StateReader(StateSource& source, std::size_t size) : left_(size), source_(&source) {}
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
    pass(values.size());
    if (source_ != nullptr) {
      source_->read(values);
    } else {
      copy(values);
    }
  }
  /// The next `count` values where one rank hands them on to others: at that rank, which has `room` for them, nothing
  /// at others, whose `room` is empty. \throws as read()
  void read_alone(std::size_t count, std::span<double> room) {
    pass(count);
    if (source_ != nullptr) {
      source_->read_alone(room);
    } else if (room.empty()) {
      rest_ = rest_.subspan(count);
    } else {
      copy(room);
    }
  }
  [[nodiscard]] bool done() const { return left_ == 0; }
  /// \throws std::invalid_argument if fewer values are left: at every rank, before one waits for another
  void require(std::size_t count) const {
    if (count > left_) {
      throw std::invalid_argument("a saved state is shorter than the object it should restore");
    }
  }

private:
  void pass(std::size_t count) {
    require(count);
    left_ -= count;
  }
  void copy(std::span<double> values) {
    std::ranges::copy(rest_.first(values.size()), values.begin());
    rest_ = rest_.subspan(values.size());
  }

  std::span<const double> rest_;
  std::size_t left_;
  StateSource* source_ = nullptr;
  StateWriter::For reader_ = StateWriter::For::record;
};

}  // namespace rubato
