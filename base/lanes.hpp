#pragma once

#include <cstdlib>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace rubato {

/// What the environment variable RUBATO_LANES says: how many doubles kernels are to take side by side (2, 4 or 8). 0
/// where it says nothing: as many as the machine can. Results do not depend on it, which is what the variable is for:
/// the tests are run with each value. \throws std::invalid_argument if the variable has another value
inline int lanes_asked_for() {
  static const int lanes = [] {
    const char* text = std::getenv("RUBATO_LANES");
    const std::string value = text == nullptr ? "" : text;
    if (value.empty()) {
      return 0;
    }
    if (value != "2" && value != "4" && value != "8") {
      throw std::invalid_argument("the environment variable RUBATO_LANES has to be 2, 4 or 8; it is " + value);
    }
    return std::stoi(value);
  }();
  return lanes;
}

/// Doubles that the widest vectors of this machine hold, 8, 4 or 2, or fewer if lanes_asked_for() says so.
inline int vector_lanes() {
  static const int lanes = [] {
    [[maybe_unused]] const int most = lanes_asked_for() == 0 ? 8 : lanes_asked_for();
#if defined(__x86_64__)
    if (most == 8 && __builtin_cpu_supports("avx512f")) {
      return 8;
    }
    if (most >= 4 && __builtin_cpu_supports("avx2")) {
      return 4;
    }
#endif
    return 2;
  }();
  return lanes;
}

/// So many doubles, for the arithmetic operators.
template <int lanes>
struct VectorOf {
  using type [[gnu::vector_size(8 * lanes)]] = double;
};

namespace lanes_detail {

#if defined(__x86_64__)
template <class Work>
[[gnu::target("avx512f"), gnu::flatten]] auto with_8(const Work& work) {
  return work(std::integral_constant<int, 8>());
}
template <class Work>
[[gnu::target("avx2"), gnu::flatten]] auto with_4(const Work& work) {
  return work(std::integral_constant<int, 4>());
}
#endif

}  // namespace lanes_detail

/// work(std::integral_constant<int, lanes>), inlined with all that it calls into code for the instruction set that has
/// vectors of so many doubles. Fused multiply-add is not among the instructions, so that all give the same bits.
/// Hypothesis: 2 <= lanes <= vector_lanes().
template <class Work>
auto in_vectors([[maybe_unused]] int lanes, const Work& work) {
#if defined(__x86_64__)
  switch (lanes) {
    case 8: return lanes_detail::with_8(work);
    case 4: return lanes_detail::with_4(work);
    default: break;
  }
#endif
  return work(std::integral_constant<int, 2>());
}

}  // namespace rubato
