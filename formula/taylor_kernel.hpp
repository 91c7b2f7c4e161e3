#pragma once

#include <cstddef>
#include <cstdint>

#include <rubato/formula/taylor_program.hpp>

/// Between TaylorEvaluator and its vector kernels; of no use elsewhere.
///
/// The same source is compiled once per instruction set. All variants do the same roundings in the same order (none
/// contracts a product and a sum), so they give the same bits, as does every lane of a vector.
namespace rubato::formula::taylor {

/// Series lie one after the other, `series_stride` doubles apart; in each, the orders, `width` doubles apart: 1, 2 or a
/// multiple of 4 lanes.
struct Work {
  double* series;
  std::size_t series_stride;
  std::size_t width;
  double* weights;  ///< scratch, as many as orders
};

/// The parts of order d ≥ 1 of everything that the groups of steps make.
using Extend = void (*)(const Work& work, const Step* steps, const Group* begin, const Group* end, int d);
/// The inputs' parts of order d + 1 from the outputs' of order d: input m = matrix·output m, the matrix (`lanes`
/// columns of `width`) acting on lanes.
using FeedBack = void (*)(const Work& work, const double* matrix, std::size_t lanes, const std::uint32_t* outputs,
                          std::size_t count, int d);
/// True if the parts of order d of some series are finite.
using Finite = bool (*)(const Work& work, const std::uint32_t* some, std::size_t count, int d);

struct Kernel {
  Extend extend;
  FeedBack feed_back;
  Finite finite;
};
[[nodiscard]] Kernel kernel_pair();
#if defined(__x86_64__)
[[nodiscard]] Kernel kernel_avx2();
#endif

}  // namespace rubato::formula::taylor
