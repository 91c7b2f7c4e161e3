#include <rubato/variation/run_span.hpp>

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

namespace {

template <typename... Values>
void refuse_if(bool wrong, fmt::format_string<Values...> message, Values&&... values) {
  if (wrong) {
    throw std::invalid_argument(fmt::format(message, std::forward<Values>(values)...));
  }
}

}  // namespace

void check_run_span(double start, double step, double until, double tolerance) {
  refuse_if(!std::isfinite(start), "the start time has to be finite; got {}", start);
  refuse_if(!std::isfinite(until), "until = {} is not finite: give the time at which the run ends", until);
  refuse_if(until == start,
            "until = {} is the start time, so that there is nothing to run: give the time at which the run ends",
            until);
  refuse_if(
      !std::isfinite(step) || step == 0.0,
      "step = {} leads nowhere: give the first step, t_1 - t_0, finite and not 0 (negative to integrate backward)",
      step);
  refuse_if((until - start) * step < 0.0,
            "a step of {} does not lead from t = {} to until = {}: change the sign of the step", step, start, until);
  refuse_if(start + step == start, "step = {} is lost in rounding beside the start t = {}: take a longer step", step,
            start);
  refuse_if(std::abs(until - start) <= end_slack * std::abs(step),
            "step = {} is so long that until = {} counts as the start t = {}: take a shorter step", step, until, start);
  refuse_if(!(tolerance > 0.0 && tolerance < 1.0),
            "tolerance = {} of the level equation is relative: it has to be between 0 and 1", tolerance);
}

}  // namespace rubato
