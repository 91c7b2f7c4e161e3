#pragma once

#include <memory>
#include <utility>

namespace rubato {

/// A T, or none, that is copied with the object it belongs to. T may be incomplete there.
template <typename T>
class Copied {
public:
  Copied() = default;
  explicit Copied(T value)
      : value_(std::make_shared<T>(std::move(value))), copy_([](const T& from) { return std::make_shared<T>(from); }) {}
  Copied(const Copied& other) : value_(other.value_ ? other.copy_(*other.value_) : nullptr), copy_(other.copy_) {}
  Copied(Copied&& other) noexcept = default;
  Copied& operator=(Copied other) noexcept {
    value_.swap(other.value_);
    std::swap(copy_, other.copy_);
    return *this;
  }
  ~Copied() = default;

  explicit operator bool() const { return value_ != nullptr; }
  T& operator*() const { return *value_; }
  T* operator->() const { return value_.get(); }

private:
  std::shared_ptr<T> value_;
  std::shared_ptr<T> (*copy_)(const T&) = nullptr;
};

}  // namespace rubato
