#include <rubato/formula/batch.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstring>
#include <limits>

#include <rubato/base/lanes.hpp>
#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/batch_kernel.hpp>
#include <rubato/formula/lazy_machine_code.hpp>
#include <rubato/formula/scalar_functions.hpp>
#include <rubato/formula/special.hpp>

namespace rubato::formula {

namespace batch {

std::span<const NamedKernel> kernels() {
#if defined(__x86_64__)
  static const std::array<NamedKernel, 3> all = [] {
    __builtin_cpu_init();
    const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512cd") &&
                        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    return std::array<NamedKernel, 3>{{{"sse2", 2, run_pair, true},
                                       {"avx2", 4, run_avx2, __builtin_cpu_supports("avx2") != 0},
                                       {"avx512", 8, run_avx512, avx512}}};
  }();
#else
  static const std::array<NamedKernel, 1> all{{{"neon64", 2, run_pair, true}}};
#endif
  return all;
}

namespace {

const NamedKernel& best_kernel() {
  static const NamedKernel& best = *std::find_if(kernels().rbegin(), kernels().rend(), [](const NamedKernel& kernel) {
    return kernel.supported && (lanes_asked_for() == 0 || kernel.lanes <= lanes_asked_for());
  });
  return best;
}

/// What the scalar evaluator calls, point after point; all else by the best kernel, whose operations are the scalar
/// ones.
void run_with_scalar_functions(const Block& block) {
  const Kernel kernel = best_kernel().run;
  for (const Instruction* i = block.begin; i != block.end; ++i) {
    const double* const a = block.read[i->a];
    double* const target = block.write[i->target];
    if (i->code == OpCode::sincos) {
      const SineAndCosine of = sincos_function();
      double* const cosine = block.write[i->b];
      for (std::size_t k = 0; k < block.points; ++k) {
        double s = 0.0, c = 0.0;
        of(a[k], &s, &c);
        target[k] = s;
        cosine[k] = c;
      }
    } else if (const ScalarFunction of = scalar_function(i->code)) {
      const double* const b = operand_count(i->code) == 2 ? block.read[i->b] : a;
      for (std::size_t k = 0; k < block.points; ++k) {
        target[k] = of(a[k], b[k]);
      }
    } else {
      kernel({block.points, i, i + 1, block.read, block.write});
    }
  }
}

/// std::copy_n, without a call for the few points of a collocation step.
inline void copy_few(const double* from, std::size_t count, double* to) {
  constexpr std::size_t few = 8;
  if (count > few) {
    std::copy_n(from, count, to);
    return;
  }
  for (std::size_t i = 0; i < count; ++i) {
    to[i] = from[i];
    __asm__ volatile("" ::: "memory");  // else this is made a call of memcpy
  }
}

}  // namespace

}  // namespace batch

std::string_view simd_name() {
  return batch::best_kernel().name;
}

BatchEvaluator::BatchEvaluator(const Bytecode& code, Engine engine, BatchFunctions functions)
    : code_(code),
      functions_(functions),
      registers_(code.loops() ? 0 : code.register_count() * batch::block_points / batch::widest_vector),
      read_(code.register_count()),
      write_(code.register_count()),
      in_place_(code.output_count()) {
  static_assert(sizeof(Chunk) == batch::widest_vector * sizeof(double));
  const auto constants = code.constants();
  for (std::size_t c = 0; c < constants.size(); ++c) {
    Chunk chunk;
    std::ranges::fill(chunk.values, constants[c]);
    constexpr std::size_t chunks = batch::block_points / batch::widest_vector;
    std::fill_n(registers_.begin() + static_cast<std::ptrdiff_t>((code.input_count() + c) * chunks), chunks, chunk);
  }
  const std::size_t first_temporary = code.input_count() + code.constants().size();
  const auto outputs = code.outputs();
  for (std::size_t j = 0; j < outputs.size(); ++j)
    in_place_[j] = outputs[j] >= first_temporary && std::ranges::count(outputs.first(j), outputs[j]) == 0;
  if (code.loops() != nullptr) {
    loops_ = Copied(ScalarEvaluator(code, engine));
  }
  if (engine == Engine::automatic && code.lazy_machine_code() != nullptr && machine_code_wanted()) {
    program_ = code.lazy_machine_code()->batch(code_, batch::best_kernel().lanes);
    work_.resize(program_ ? (program_->work_size() + batch::widest_vector - 1) / batch::widest_vector : 0);
  }
}

void BatchEvaluator::operator()(std::size_t points, std::span<const double* const> inputs,
                                std::span<double* const> outputs) {
  assert(inputs.size() == code_.input_count() && outputs.size() == code_.output_count());
  using batch::block_points;
  using batch::widest_vector;

  if (loops_) {
    run_loops(points, inputs, outputs);
    return;
  }
  find_registers();
  bound_.stand = false;
  double* const registers = registers_.empty() ? nullptr : registers_.front().values;
  const batch::Kernel kernel =
      functions_ == BatchFunctions::vector ? batch::best_kernel().run : batch::run_with_scalar_functions;
  const auto instructions = code_.instructions();
  const auto registers_of_outputs = code_.outputs();
  for (std::size_t start = 0, count = 0; start < points; start += count) {
    count = std::min(block_points, points - start);
    if (count > widest_vector && !in_place(count)) {
      count -= count % widest_vector;  // the rest, which is copied, alone
    }
    const bool whole = in_place(count);
    const std::size_t padded = whole ? count : (count + widest_vector - 1) / widest_vector * widest_vector;
    for (std::size_t m = 0; m < inputs.size(); ++m) {
      if (whole) {
        read_[m] = inputs[m] + start;
      } else {
        batch::copy_few(inputs[m] + start, count, write_[m]);
        for (std::size_t i = count; i < padded; ++i)
          write_[m][i] = inputs[m][start + count - 1];
        read_[m] = write_[m];
      }
    }
    for (std::size_t j = 0; j < outputs.size(); ++j)
      if (in_place_[j]) {
        const std::uint32_t r = registers_of_outputs[j];
        read_[r] = write_[r] = whole ? outputs[j] + start : registers + r * block_points;
      }
    const batch::Block block{padded, instructions.data(), instructions.data() + instructions.size(), read_.data(),
                             write_.data()};
    if (program_)
      program_->run(block, kernel, work_.empty() ? nullptr : work_.front().values);
    else
      kernel(block);
    for (std::size_t j = 0; j < outputs.size(); ++j)
      if (!whole || !in_place_[j])
        batch::copy_few(read_[registers_of_outputs[j]], count, outputs[j] + start);
  }
}

bool BatchEvaluator::in_place(std::size_t points) const {
  return points % batch::widest_vector == 0 || (program_ && program_->takes_any_number());
}

void BatchEvaluator::run_loops(std::size_t points, std::span<const double* const> inputs,
                               std::span<double* const> outputs) {
  for (std::size_t i = 0; i < points; ++i) {
    std::ranges::transform(inputs, loops_->inputs().begin(), [i](const double* input) { return input[i]; });
    loops_->run();
    for (std::size_t j = 0; j < outputs.size(); ++j) {
      outputs[j][i] = loops_->output(j);
    }
  }
}

/// Anew where the evaluator has been copied.
void BatchEvaluator::find_registers() {
  double* const registers = registers_.empty() ? nullptr : registers_.front().values;
  if (registers != base_) {
    base_ = registers;
    for (std::size_t r = 0; r < read_.size(); ++r)
      read_[r] = write_[r] = registers + r * batch::block_points;
    bound_.stand = false;
  }
}

void BatchEvaluator::bind(std::size_t points, std::span<const double* const> inputs, std::span<double* const> outputs) {
  assert(points <= batch::block_points && inputs.size() == code_.input_count() &&
         outputs.size() == code_.output_count());
  bound_ = {points, {inputs.begin(), inputs.end()}, {outputs.begin(), outputs.end()}, {}, false, nullptr};
}

void BatchEvaluator::run() {
  find_registers();
  if (!bound_.stand) {
    if (loops_ || !in_place(bound_.points)) {
      (*this)(bound_.points, bound_.inputs, bound_.outputs);
      return;
    }
    std::ranges::copy(bound_.inputs, read_.begin());
    bound_.copies.clear();
    for (std::size_t j = 0; j < bound_.outputs.size(); ++j) {
      const std::uint32_t r = code_.outputs()[j];
      if (in_place_[j]) {
        read_[r] = write_[r] = bound_.outputs[j];
      }
    }
    for (std::size_t j = 0; j < bound_.outputs.size(); ++j) {
      if (!in_place_[j]) {
        bound_.copies.push_back({read_[code_.outputs()[j]], bound_.outputs[j]});
      }
    }
    bound_.all = program_ ? program_->in_one_go(bound_.points) : nullptr;
    bound_.stand = true;
  }
  run_bound();
}

void BatchEvaluator::run_bound() {
  double* const work = work_.empty() ? nullptr : work_.front().values;
  if (bound_.all != nullptr) {
    // Inputs are read alone, all others are where they are written.
    bound_.all(const_cast<double* const*>(read_.data()), work, 0, bound_.points * sizeof(double));
  } else if (const auto instructions = code_.instructions(); !instructions.empty()) {
    const batch::Kernel kernel =
        functions_ == BatchFunctions::vector ? batch::best_kernel().run : batch::run_with_scalar_functions;
    const batch::Block block{bound_.points, instructions.data(), instructions.data() + instructions.size(),
                             read_.data(), write_.data()};
    if (program_) {
      program_->run(block, kernel, work);
    } else {
      kernel(block);
    }
  }
  for (const Places::Copy& copy : bound_.copies) {
    if (bound_.points == batch::widest_vector) {  // in one piece, for who reads it as a vector at once
      std::memcpy(copy.to, copy.from, batch::widest_vector * sizeof(double));
    } else {
      batch::copy_few(copy.from, bound_.points, copy.to);
    }
  }
}

}  // namespace rubato::formula
