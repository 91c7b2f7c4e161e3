#pragma once

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

#include <rubato/grids/buffer.hpp>
#include <rubato/grids/parallel.hpp>

namespace rubato::grids {

/// `fields` arrays of `size` values each, one after the other without gaps (structure of arrays): value i of field f is
/// data()[f·size + i]. Zero at the start, which takes no memory before something is written (Buffer).
class FieldSet {
public:
  FieldSet() = default;
  /// Throws std::bad_alloc.
  FieldSet(int fields, std::size_t size) : buffer_(static_cast<std::size_t>(fields) * size), size_(size) {
    for (int f = 0; f < fields; ++f) {
      pointers_.push_back(buffer_.data() + static_cast<std::size_t>(f) * size);
      const_pointers_.push_back(pointers_.back());
    }
  }
  FieldSet(const FieldSet& other) : FieldSet(other.fields(), other.size_) { copy_from(other); }
  FieldSet(FieldSet&&) noexcept = default;
  FieldSet& operator=(FieldSet other) noexcept {
    buffer_ = std::move(other.buffer_);
    pointers_ = std::move(other.pointers_);
    const_pointers_ = std::move(other.const_pointers_);
    size_ = other.size_;
    return *this;
  }

  [[nodiscard]] int fields() const { return static_cast<int>(pointers_.size()); }
  [[nodiscard]] std::size_t size() const { return size_; }

  [[nodiscard]] std::span<double> field(int f) { return {pointers_[f], size_}; }
  [[nodiscard]] std::span<const double> field(int f) const { return {const_pointers_[f], size_}; }
  [[nodiscard]] std::span<double> all() { return buffer_.span(); }
  [[nodiscard]] std::span<const double> all() const { return buffer_.span(); }

  /// One pointer for each field, as batch evaluation and the solvers take them.
  [[nodiscard]] std::span<double* const> pointers() { return pointers_; }
  [[nodiscard]] std::span<const double* const> pointers() const { return const_pointers_; }

  /// Gives the memory of a field back: its values are lost.
  void forget(int f) { buffer_.forget(static_cast<std::size_t>(f) * size_, size_); }
  void fill(double value) { parallel_fill(buffer_.data(), buffer_.size(), value); }
  /// Hypothesis: the same shape.
  void copy_from(const FieldSet& other) {
    for_each_block(buffer_.size(), nodes_per_block, [&](std::size_t begin, std::size_t end) {
      std::copy(other.buffer_.data() + begin, other.buffer_.data() + end, buffer_.data() + begin);
    });
  }

private:
  Buffer buffer_;
  std::vector<double*> pointers_;
  std::vector<const double*> const_pointers_;
  std::size_t size_ = 0;
};

}  // namespace rubato::grids
