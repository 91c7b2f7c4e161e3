#pragma once

#if __has_include(<boost/numeric/odeint.hpp>)

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <boost/numeric/odeint.hpp>
#include <boost/numeric/odeint/stepper/symplectic_rkn_sb3a_m4_mclachlan.hpp>

#include "case.hpp"

namespace orbits {

/// Boost.Odeint with its own choice of steps. \tparam Make \return a controlled stepper for a tolerance
template <typename System, typename Make>
class OdeintControlled {
  static constexpr std::size_t n = System::n;
  using Z = std::array<double, 2 * n>;

public:
  explicit OdeintControlled(Make make) : make_(make), z_(std::make_unique<Z>()) {}
  OdeintControlled(const OdeintControlled& other) : OdeintControlled(other.make_) {}

  template <typename Watch>
  Taken operator()(int effort, double until, State<System>& state, Watch& watch) {
    auto stepper = make_(tolerance_of(effort));
    Z& z = *z_;
    std::copy_n(state.q.begin(), n, z.begin());
    std::copy_n(state.p.begin(), n, z.begin() + static_cast<std::ptrdiff_t>(n));
    const auto slope = [](const Z& at, Z& out, double) {
      field<System>(at.data(), at.data() + n, out.data(), out.data() + n);
    };
    const double start = peers::cpu_seconds();
    double t = 0.0, h = 1e-4 * until;
    long steps = 0;
    while (t < until) {
      h = std::min(h, until - t);
      if (++steps > 20'000'000 || !(h > 1e-14 * until)) {
        if (until - t < 1e-12 * until) {
          break;
        }
        return {std::numeric_limits<double>::infinity(), steps, t};
      }
      if (stepper.try_step(slope, z, t, h) == boost::numeric::odeint::success) {
        if constexpr (Watch::active) {
          watch(z.data(), z.data() + n);
        }
      }
    }
    const double seconds = peers::cpu_seconds() - start;
    std::copy_n(z.begin(), n, state.q.begin());
    std::copy_n(z.begin() + static_cast<std::ptrdiff_t>(n), n, state.p.begin());
    return {seconds, steps, t};
  }

private:
  Make make_;
  std::unique_ptr<Z> z_;
};

/// Its symplectic methods of Nyström's kind.
template <typename System, template <typename...> typename Stepper>
class OdeintSymplectic {
  static constexpr std::size_t n = System::n;
  using X = std::array<double, n>;

public:
  OdeintSymplectic() : q_(std::make_unique<X>()), p_(std::make_unique<X>()) {}
  OdeintSymplectic(const OdeintSymplectic&) : OdeintSymplectic() {}

  template <typename Watch>
  Taken operator()(int steps, double until, State<System>& state, Watch& watch) {
    Stepper<X> stepper;
    std::copy_n(state.q.begin(), n, q_->begin());
    std::copy_n(state.p.begin(), n, p_->begin());
    const auto velocity = [](const X& p, X& v) { System::velocity(p.data(), v.data()); };
    const auto force = [](const X& q, X& f) { System::force(q.data(), f.data()); };
    const auto both = std::make_pair(velocity, force);
    const double h = until / steps;
    const double start = peers::cpu_seconds();
    for (int i = 0; i < steps; ++i) {
      stepper.do_step(both, *q_, *p_, h * i, h);
      if constexpr (Watch::active) {
        watch(q_->data(), p_->data());
      }
    }
    const double seconds = peers::cpu_seconds() - start;
    std::copy_n(q_->begin(), n, state.q.begin());
    std::copy_n(p_->begin(), n, state.p.begin());
    return {seconds, steps, until};
  }

private:
  std::unique_ptr<X> q_, p_;
};

/// \param first steps to begin the search for equal ones with; 0: none of these
template <typename System>
void add_odeint(const Case<System>& problem, int first, std::vector<Method>& methods) {
  namespace odeint = boost::numeric::odeint;
  using Z = std::array<double, 2 * System::n>;
  const auto controlled = [&](std::string name, auto make) {
    methods.push_back(
        problem.method(std::move(name), Class::odeint, 3, OdeintControlled<System, decltype(make)>(make)));
  };
  controlled("fehlberg78", [](double tolerance) {
    return odeint::make_controlled<odeint::runge_kutta_fehlberg78<Z>>(tolerance, tolerance);
  });
  controlled("dopri5", [](double tolerance) {
    return odeint::make_controlled<odeint::runge_kutta_dopri5<Z>>(tolerance, tolerance);
  });
  controlled("bulirsch-stoer", [](double tolerance) { return odeint::bulirsch_stoer<Z>(tolerance, tolerance); });
  if (first == 0) {
    return;
  }
  if constexpr (System::separable) {
    methods.push_back(problem.method("sb3a-mclachlan", Class::odeint, first,
                                     OdeintSymplectic<System, odeint::symplectic_rkn_sb3a_mclachlan>()));
    methods.push_back(problem.method("sb3a-m4-mclachlan", Class::odeint, first,
                                     OdeintSymplectic<System, odeint::symplectic_rkn_sb3a_m4_mclachlan>()));
  }
}

}  // namespace orbits

#else

#include <vector>

#include "case.hpp"

namespace orbits {
template <typename System>
void add_odeint(const Case<System>&, int, std::vector<Method>&) {}
}  // namespace orbits

#endif
