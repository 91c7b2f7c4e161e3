#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include <rubato/variation/composition.hpp>

namespace peers {

/// What a composition comes to over many steps: a pass is a kick and the drift after it, and parts of the same kind
/// that meet between steps are one.
struct Passes {
  struct Pass {
    double kick = 0.0;
    std::size_t drift = 0;
  };
  std::vector<double> drifts = {0.0};  ///< lengths, each once
  Pass first;
  std::vector<Pass> step, last;  ///< all steps but the last one, and that

  explicit Passes(const rubato::Composition& composition) {
    const auto& parts = composition.parts;
    const bool drifts_first = parts.front().drift;
    std::vector<double> kicks, lengths;
    for (const auto& part : parts) {
      (part.drift ? lengths : kicks).push_back(part.length);
    }
    if (drifts_first) {  // D₀ (K D)ⁿ: the last drift meets the first of the next step
      first = {0.0, drift(lengths.front())};
      for (std::size_t i = 0; i < kicks.size(); ++i) {
        last.push_back({kicks[i], drift(lengths[i + 1])});
      }
      step = last;
      step.back().drift = drift(lengths.back() + lengths.front());
    } else {  // (K D)ⁿ K: the last kick meets the first of the next step, so that passes begin one kick later
      first = {kicks.front(), drift(lengths.front())};
      for (std::size_t i = 1; i < kicks.size(); ++i) {
        last.push_back({kicks[i], i < lengths.size() ? drift(lengths[i]) : 0});
      }
      step = last;
      step.back() = {kicks.back() + kicks.front(), drift(lengths.front())};
    }
  }
  template <class F>
  void run(int steps, F&& pass) const {
    pass(first);
    for (int i = 1; i < steps; ++i) {
      for (const Pass& one : step) {
        pass(one);
      }
    }
    for (const Pass& one : last) {
      pass(one);
    }
  }

private:
  std::size_t drift(double length) {
    for (std::size_t i = 0; i < drifts.size(); ++i) {
      if (std::abs(drifts[i] - length) < 1e-15) {
        return i;
      }
    }
    drifts.push_back(length);
    return drifts.size() - 1;
  }
};

}  // namespace peers
