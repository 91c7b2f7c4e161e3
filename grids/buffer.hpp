#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <span>

namespace rubato::grids {

/// An owned, uninitialised array of doubles, aligned to 64 bytes (a cache line, the widest vector register). Pages that
/// nobody has written belong to nobody: who writes them first decides where they live, so large arrays should be
/// filled by the threads that will use them (`parallel_fill`).
class Buffer {
public:
  static constexpr std::size_t alignment = 64;

  Buffer() = default;
  /// Throws std::bad_alloc.
  explicit Buffer(std::size_t size) : size_(size) {
    if (size > 0) {
      const std::size_t bytes = (size * sizeof(double) + alignment - 1) / alignment * alignment;
      data_.reset(static_cast<double*>(std::aligned_alloc(alignment, bytes)));
      if (data_ == nullptr) {
        throw std::bad_alloc();
      }
    }
  }

  [[nodiscard]] double* data() { return data_.get(); }
  [[nodiscard]] const double* data() const { return data_.get(); }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::span<double> span() { return {data_.get(), size_}; }
  [[nodiscard]] std::span<const double> span() const { return {data_.get(), size_}; }
  double& operator[](std::size_t i) { return data_.get()[i]; }
  double operator[](std::size_t i) const { return data_.get()[i]; }

private:
  struct Free {
    void operator()(double* p) const { std::free(p); }
  };
  std::unique_ptr<double, Free> data_;
  std::size_t size_ = 0;
};

}  // namespace rubato::grids
