#include <rubato/variation/integrator.hpp>

#include <cmath>

#include <fmt/format.h>

#include <rubato/variation/bridge_causes.hpp>

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

std::string Integrator::explain(const StepReport& failed) {
  return describe_failure(failed, t(), node(), levels_->last_step(), levels_->options().on_singular, failure_reason(),
                          traits());
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

std::string gamma_name(const StepReport& report, int order) {
  return report.gamma_from_slope ? slope_name(order) : "Gamma";
}

std::string trend_of(const StepReport& report, int order) {
  return fmt::format("{} went from {:.4g} to {:.4g} over the last step", gamma_name(report, order), report.gamma_before,
                     report.gamma_after);
}

/// `has_gamma`: whether the scheme knows its Γ, so that there are bridges (with stop, the report has it from slopes all
/// the same, since no level before is kept).
std::string why_singular(const StepReport& report, OnSingular on_singular, bool has_gamma, const SchemeTraits& scheme) {
  const GammaTrend trend{report.gamma_before, report.gamma_after};
  const bool bridging = on_singular == OnSingular::bridge && has_gamma;
  const bool plain = on_singular == OnSingular::fixed;
  if (trend.meets_zero()) {
    const std::string what = fmt::format("{} nears 0 there ({}; theory, section {})", gamma_name(report, scheme.order),
                                         trend_of(report, scheme.order), has_gamma ? 3 : 8);
    if (bridging) {
      return what + ", and no bridge over it was found; use another step, or levels = \"fixed\"";
    }
    if (!scheme.bridged.empty()) {
      return fmt::format(
          "{}, and this scheme has no bridges; use step_potential = \"auto\", {}levels = \"fixed\", or {}", what,
          plain ? "" : "on_singular = \"fixed\", ", scheme.bridged);
    }
    return what + (!has_gamma || plain ? "; use another step, or levels = \"fixed\""
                                       : "; use on_singular = \"bridge\" or \"fixed\", or levels = \"fixed\"");
  }
  if (trend.known() && trend.ratio() > GammaTrend::changes_much) {
    return fmt::format("the step is too long for the motion: {}; take a smaller step", trend_of(report, scheme.order));
  }
  return fmt::format(
      "E(h) turns back, or leaves the branch the run is on, before it comes to E; take a smaller step, {}",
      scheme.bridged.empty() ? "or levels = \"fixed\"" : fmt::format("levels = \"fixed\", or {}", scheme.bridged));
}

}  // namespace

std::string slope_name(int order) {
  return order == 2   ? "-(4/h) dE/dh"
         : order == 1 ? "-12 dE/dh"
                      : fmt::format("-(24/({} h^{})) dE/dh", order * (order + 1), order - 1);
}

std::string describe_failure(const StepReport& report, double t, const NodeEnergy& node, double last_step,
                             OnSingular on_singular, std::string_view reason, const SchemeTraits& scheme) {
  const std::string where =
      std::isfinite(node.gamma)
          ? fmt::format("at t = {:.10g}, Gamma = {:.4g}, last step h = {:.4g}", t, node.gamma, last_step)
          : fmt::format("at t = {:.10g}, last step h = {:.4g}", t, last_step);
  switch (report.status) {
    case Status::success: return {};
    case Status::singular:
      return fmt::format("the step equation has no solution with the required energy {}: {}", where,
                         why_singular(report, on_singular, std::isfinite(node.gamma), scheme));
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
                       where, trend_of(report, scheme.order))
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
