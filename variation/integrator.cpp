#include <rubato/variation/integrator.hpp>

#include <cmath>

#include <fmt/format.h>

#include <rubato/variation/off_law_causes.hpp>

namespace rubato {

bool Integrator::finished() const {
  const double direction = forward_ ? 1.0 : -1.0;
  return direction * (levels_->time() - until_) >= -end_slack * std::abs(levels_->last_step());
}

NodeEnergy Integrator::node() {
  NodeEnergy node = level_scheme_->node();
  node.energy += node_constant_;
  return node;
}

NodeEnergy Integrator::reported_node() {
  NodeEnergy reported = node();
  reported.gamma /= level_scheme_->gamma_factor();
  return reported;
}

std::string Integrator::explain(const StepReport& failed) {
  return describe_failure(failed, t(), reported_node(), levels_->last_step(), levels_->options(), order(),
                          failure_reason());
}

void Integrator::save(StateWriter& state) const {
  level_scheme_->save(state);
  levels_->save(state);
}

void Integrator::restore(StateReader& state) {
  level_scheme_->restore(state);
  levels_->restore(state);
}

namespace {

std::string gamma_name(bool has_gamma, int order) {
  return has_gamma ? "Gamma" : slope_name(order);
}

std::string trend_of(const StepReport& report, bool has_gamma, int order) {
  return fmt::format("{} went from {:.4g} to {:.4g} over the last step", gamma_name(has_gamma, order),
                     report.gamma_before, report.gamma_after);
}

std::string why_singular(const StepReport& report, const LevelOptions& options, bool has_gamma, int order) {
  const GammaTrend trend{report.gamma_before, report.gamma_after};
  const bool pure = options.potential.kind == StepPotentialChoice::Kind::none;
  const std::string plain = options.on_singular == OnSingular::stop ? "on_singular = \"plain\", " : "";
  if (trend.meets_zero()) {
    return fmt::format("{} nears 0 there ({}; theory, section {}); use {}{}levels = \"fixed\"",
                       gamma_name(has_gamma, order), trend_of(report, has_gamma, order), has_gamma ? 3 : 8,
                       pure ? "step_potential = \"auto\", " : "another step, ", plain.empty() ? "or " : plain + "or ");
  }
  if (trend.known() && trend.ratio() > GammaTrend::changes_much) {
    return fmt::format("the step is too long for the motion: {}; take a smaller step",
                       trend_of(report, has_gamma, order));
  }
  return "E(h) turns back, or leaves the branch the run is on, before it comes to E; take a smaller step, or levels = "
         "\"fixed\"";
}

}  // namespace

std::string slope_name(int order) {
  return order == 2   ? "-(4/h) dE/dh"
         : order == 1 ? "-12 dE/dh"
                      : fmt::format("-(24/({} h^{})) dE/dh", order * (order + 1), order - 1);
}

std::string describe_failure(const StepReport& report, double t, const NodeEnergy& node, double last_step,
                             const LevelOptions& options, int order, std::string_view reason) {
  const bool has_gamma = std::isfinite(node.gamma);
  const std::string where =
      has_gamma ? fmt::format("at t = {:.10g}, Gamma = {:.4g}, last step h = {:.4g}", t, node.gamma, last_step)
                : fmt::format("at t = {:.10g}, last step h = {:.4g}", t, last_step);
  switch (report.status) {
    case Status::success: return {};
    case Status::singular:
      return fmt::format("the step equation has no solution with the required energy {}: {}", where,
                         why_singular(report, options, has_gamma, order));
    case Status::ill_conditioned:
      if (report.condition <= LevelOptions{}.condition_limit) {
        return fmt::format(
            "the energy law carries no information {}: the terms of the energy have grown until rounding in them is "
            "seen beside all that they were at the first step, as when a motion blows up; end the run before it does",
            where);
      }
      return fmt::format(
          "the energy law carries no information {}: the step condition {:.3g} exceeds 1e-2, rounding in H alone moves "
          "h; take a larger step, or levels = \"fixed\"",
          where, report.condition);
    case Status::not_converged: {
      const GammaTrend trend{report.gamma_before, report.gamma_after};
      return trend.known() && trend.ratio() > GammaTrend::changes_much
                 ? fmt::format(
                       "the step could not be solved {}: it is too long for a motion that speeds up like this "
                       "({}); take a smaller step, and end the run before the motion blows up, if it does",
                       where, trend_of(report, has_gamma, order))
                 : fmt::format("the step could not be solved {}: the iteration did not settle; take a smaller step",
                               where);
    }
    case Status::undefined:
      return fmt::format(
          "the formula became undefined{} on the way from the level {}: the orbit leaves the domain of H, or the step "
          "is too long",
          reason.empty() ? std::string(" (not finite)") : fmt::format(" ({})", reason), where);
  }
  return {};
}

}  // namespace rubato
