#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/formula/loop_program.hpp>
#include <rubato/formula/rounding.hpp>

namespace rubato::formula {

/// Runs a LoopProgram at one point: the bodies of 256 iterations at a time by a BatchEvaluator. The sums of a block are
/// added by eights, and sums of everything with their rounding errors carried along.
class LoopEvaluator {
public:
  LoopEvaluator(std::shared_ptr<const LoopProgram> program, Engine engine);
  void operator()(const double* inputs, double* outputs);

private:
  struct Runner {
    const LoopCode* code;
    BatchEvaluator body;
    std::vector<double> values;  ///< of slots, then of terms, one block after the other
    std::vector<const double*> slots;
    std::vector<double*> terms;
    std::vector<CompensatedSum> sums;  ///< of terms with one target
    /// A part of a block that lies in one stretch: iterations first … first + count - 1 of it, from place `at` on.
    struct Piece {
      std::size_t stretch, first, count, at;
    };
    std::vector<Piece> pieces;
  };
  struct Stage {
    ScalarEvaluator arguments;
    std::vector<Runner> loops;
  };
  static void run(Runner& runner, const double* arguments, double* outputs);

  std::shared_ptr<const LoopProgram> program_;
  std::vector<Stage> stages_;
  ScalarEvaluator rest_;
  std::vector<double> values_, arguments_;
};

/// The same with a bound of the rounding error of each value (RoundingEvaluator), iteration after iteration.
class LoopRounding {
public:
  explicit LoopRounding(std::shared_ptr<const LoopProgram> program);
  void operator()(std::span<const double> inputs, std::span<const double> errors);
  [[nodiscard]] const RoundingEvaluator& rest() const { return rest_; }

private:
  struct Stage {
    RoundingEvaluator arguments;
    std::vector<RoundingEvaluator> bodies;
  };
  void run(const LoopCode& code, RoundingEvaluator& body, std::size_t first_output);

  std::shared_ptr<const LoopProgram> program_;
  std::vector<Stage> stages_;
  RoundingEvaluator rest_;
  std::vector<double> values_, bounds_, arguments_, errors_, slots_, slot_errors_;
};

}  // namespace rubato::formula
