#pragma once

#include <fftw3.h>

#include <algorithm>
#include <complex>
#include <cstddef>
#include <new>
#include <vector>

/// \file
/// Transforms of one length, planned by measurement.

namespace peers {

using Complex = std::complex<double>;

/// Memory as FFTW likes it, so that one plan serves all arrays.
template <class T>
struct Aligned {
  using value_type = T;
  Aligned() = default;
  template <class U>
  Aligned(const Aligned<U>&) {}
  T* allocate(std::size_t n) {
    void* memory = fftw_malloc(n * sizeof(T));
    return memory != nullptr ? static_cast<T*>(memory) : throw std::bad_alloc();
  }
  void deallocate(T* memory, std::size_t) { fftw_free(memory); }
  template <class U>
  bool operator==(const Aligned<U>&) const {
    return true;
  }
};
using Modes = std::vector<Complex, Aligned<Complex>>;
using Nodes = std::vector<double, Aligned<double>>;

inline fftw_complex* raw(Complex* values) {
  return reinterpret_cast<fftw_complex*>(values);
}

/// Transforms so far, of both kinds.
inline long transforms = 0;

/// Of real values; half of the modes are kept.
class RealTransform {
public:
  explicit RealTransform(std::size_t n) : x(n), scratch_(n / 2 + 1) {
    const int length = static_cast<int>(n);
    forward_ = fftw_plan_dft_r2c_1d(length, x.data(), raw(scratch_.data()), FFTW_PATIENT);
    inverse_ = fftw_plan_dft_c2r_1d(length, raw(scratch_.data()), x.data(), FFTW_PATIENT);
  }
  RealTransform(const RealTransform&) = delete;
  RealTransform& operator=(const RealTransform&) = delete;
  ~RealTransform() {
    fftw_destroy_plan(forward_);
    fftw_destroy_plan(inverse_);
  }
  /// From x.
  void forward(Modes& out) {
    ++transforms;
    fftw_execute_dft_r2c(forward_, x.data(), raw(out.data()));
  }
  /// Into x, without the factor 1/n.
  void inverse(const Modes& in) {
    ++transforms;
    std::copy(in.begin(), in.end(), scratch_.begin());
    fftw_execute(inverse_);
  }

  Nodes x;

private:
  Modes scratch_;
  fftw_plan forward_, inverse_;
};

/// Of complex values.
class ComplexTransform {
public:
  explicit ComplexTransform(std::size_t n) : x(n), scratch_(n) {
    const int length = static_cast<int>(n);
    forward_ = fftw_plan_dft_1d(length, raw(x.data()), raw(scratch_.data()), FFTW_FORWARD, FFTW_PATIENT);
    inverse_ = fftw_plan_dft_1d(length, raw(scratch_.data()), raw(x.data()), FFTW_BACKWARD, FFTW_PATIENT);
  }
  ComplexTransform(const ComplexTransform&) = delete;
  ComplexTransform& operator=(const ComplexTransform&) = delete;
  ~ComplexTransform() {
    fftw_destroy_plan(forward_);
    fftw_destroy_plan(inverse_);
  }
  /// From x, which is lost.
  void forward(Modes& out) {
    ++transforms;
    fftw_execute_dft(forward_, raw(x.data()), raw(out.data()));
  }
  /// Into x, without the factor 1/n.
  void inverse(const Modes& in) {
    ++transforms;
    std::copy(in.begin(), in.end(), scratch_.begin());
    fftw_execute(inverse_);
  }

  Modes x;

private:
  Modes scratch_;
  fftw_plan forward_, inverse_;
};

}  // namespace peers
