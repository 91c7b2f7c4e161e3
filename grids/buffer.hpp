#pragma once

#include <cstddef>
#include <memory>
#include <span>

namespace rubato::grids {

/// An owned array of zeros, aligned to 64 bytes (a cache line, the widest vector register). Memory is taken page by
/// page, when a page is first written: an array that nothing is written to takes none, and the thread that writes a
/// page first decides where it lives.
class Buffer {
public:
  static constexpr std::size_t alignment = 64;

  Buffer() = default;
  /// Throws std::bad_alloc.
  explicit Buffer(std::size_t size);

  /// Gives the memory of `count` values from `first` on back to the system, as far as they have pages of their own.
  /// The values are lost.
  void forget(std::size_t first, std::size_t count);

  [[nodiscard]] double* data() { return data_.get(); }
  [[nodiscard]] const double* data() const { return data_.get(); }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::span<double> span() { return {data_.get(), size_}; }
  [[nodiscard]] std::span<const double> span() const { return {data_.get(), size_}; }
  double& operator[](std::size_t i) { return data_.get()[i]; }
  double operator[](std::size_t i) const { return data_.get()[i]; }

private:
  struct Free {
    void* block;            ///< what was allocated
    std::size_t of_system;  ///< bytes of a mapping; 0: of the heap
    void operator()(double* p) const;
  };
  using Owned = std::unique_ptr<double, Free>;
  Owned data_;
  std::size_t size_ = 0;
};

}  // namespace rubato::grids
