// What every scheme for orbits has to do, for every one that the registry has.

#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/midpoint_scheme.hpp>
#include <rubato/ode/orbit_methods.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/two_step_scheme.hpp>
#include <rubato/variation/composition.hpp>
#include <rubato/variation/total_variation.hpp>

using namespace rubato;

namespace {

/// Every scheme in a few of its forms. \param name of orbit_methods()
std::vector<SegmentLagrangian> forms_of(std::string_view name) {
  if (name == "generating") {
    return {Generating{.order = 2}, Generating{.order = 4}, Generating{.order = 6},
            Generating{.order = 1, .darboux = DarbouxType::euler_a},
            Generating{.order = 3, .darboux = Eigen::MatrixXd(Eigen::MatrixXd::Identity(2, 2))}};
  }
  if (name == "custom") {
    return {Custom{.L = "(p_0+p_1)/2*(q_1-q_0)/(t_1-t_0) - ((p_0+p_1)/2)^2/2 + cos((q_0+q_1)/2)"}};
  }
  if (name == "gauss") {
    return {Gauss{1}, Gauss{2}, Gauss{3}, Gauss{4}};
  }
  if (name == "splitting") {
    std::vector<SegmentLagrangian> all;
    for (const Composition& one : compositions()) {
      all.emplace_back(Splitting{std::string(one.name)});
    }
    return all;
  }
  if (name == "lobatto") {
    return {Lobatto{2}, Lobatto{3}, Lobatto{4}};
  }
  return name == "midpoint"    ? std::vector<SegmentLagrangian>{Midpoint{}}
         : name == "forward"   ? std::vector<SegmentLagrangian>{Forward{}}
         : name == "trapezoid" ? std::vector<SegmentLagrangian>{Trapezoid{}}
                               : std::vector<SegmentLagrangian>{};
}

/// A pendulum, stated by H or by L.
struct Form {
  SegmentLagrangian scheme;
  bool by_L = false;
  std::string reported;
};

std::vector<Form> all_forms() {
  std::vector<Form> all;
  for (const OrbitMethod& method : orbit_methods()) {
    for (const SegmentLagrangian& one : forms_of(method.name)) {
      for (const bool by_L : {false, true}) {
        if (by_L ? method.of_lagrangian() : method.of_hamiltonian()) {
          all.push_back(
              {one, by_L, std::string(method.name) + (by_L ? " of L" : "") + ", " + std::to_string(all.size())});
        }
      }
    }
  }
  return all;
}

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
const Lagrangian pendulum_by_L({"q"}, "q_dot^2/2 + cos(q)");
constexpr double start[] = {0.3, 1.2};
constexpr double first_step = 0.1;

std::unique_ptr<SegmentScheme> make(const Form& form, double h = first_step, std::span<const double> z = start) {
  if (form.by_L) {
    return make_one_step_scheme(pendulum_by_L, form.scheme, z.first(1), z.last(1));
  }
  if (method_of(form.scheme).scheme != nullptr) {
    return make_one_step_scheme(pendulum, form.scheme, z);
  }
  const auto midpoint = make_midpoint_scheme(pendulum, z);
  REQUIRE(midpoint->advance(h, 0.0) == Status::success);
  midpoint->accept();
  const auto next = midpoint->state();
  return make_two_step_scheme(make_action(pendulum, form.scheme), pendulum, {0.0, {z.begin(), z.end()}},
                              {h, {next.begin(), next.end()}}, std::nullopt);
}

std::vector<double> after(SegmentScheme& scheme, double h, int steps) {
  for (int k = 0; k < steps; ++k) {
    REQUIRE(scheme.advance(h, 0.0) == Status::success);
    scheme.accept();
  }
  return {scheme.state().begin(), scheme.state().end()};
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1]);
}

}  // namespace

TEST_CASE("every scheme for orbits is in the registry under its own name, and in this suite") {
  const std::vector<std::pair<SegmentLagrangian, std::string>> all = {
      {Midpoint{}, "midpoint"}, {Forward{}, "forward"},     {Generating{}, "generating"}, {Custom{}, "custom"},
      {Gauss{}, "gauss"},       {Splitting{}, "splitting"}, {Trapezoid{}, "trapezoid"},   {Lobatto{}, "lobatto"}};
  CHECK(all.size() == orbit_methods().size());
  for (const auto& [scheme, name] : all) {
    INFO(name);
    CHECK(method_of(scheme).name == name);
    CHECK_FALSE(forms_of(name).empty());
    for (const SegmentLagrangian& form : forms_of(name)) {
      CHECK(form.index() == scheme.index());
    }
    CHECK((method_of(scheme).of_hamiltonian() || method_of(scheme).of_lagrangian()));
  }
}

TEST_CASE("every scheme for orbits continues from a saved state bit by bit, whatever was tried in between") {
  for (const Form& form : all_forms()) {
    INFO(form.reported);
    const auto straight = make(form), resumed = make(form), other = make(form);
    const bool unstable = method_of(form.scheme).name == "forward";
    const int steps = unstable ? 1 : 3;
    const double next_step = unstable ? first_step : 0.11;
    static_cast<void>(after(*straight, first_step, steps));
    StateWriter saved;
    straight->save(saved);
    static_cast<void>(resumed->advance(0.2, 0.0));
    StateReader reader(saved.values());
    resumed->restore(reader);
    CHECK(reader.done());
    const auto expected = after(*straight, next_step, steps - steps / 2);
    CHECK(after(*resumed, next_step, steps - steps / 2) == expected);
    CHECK(after(*other, next_step, steps - steps / 2) != expected);  // the twin: from another level
  }
}

TEST_CASE("every scheme for orbits is unimpressed by trials that it does not accept") {
  // What is tried before decides where an iteration begins, and so the last digits: rounding of one step, which the
  // forward 𝕃 multiplies by 16/h².
  for (const Form& form : all_forms()) {
    INFO(form.reported);
    const auto plain = make(form), tried = make(form);
    static_cast<void>(tried->advance(0.15, 0.0));
    static_cast<void>(tried->advance(1e200, 0.0));
    static_cast<void>(tried->advance(std::numeric_limits<double>::quiet_NaN(), 0.0));
    static_cast<void>(tried->advance(0.08, 1e-6));
    const double rounding = method_of(form.scheme).name == "forward" ? 1e-11 : 1e-14;
    CHECK(distance(after(*plain, first_step, 1), after(*tried, first_step, 1)) < rounding);
  }
}

TEST_CASE("no scheme for orbits adds to the graph of its problem, which others may be reading") {
  const auto size = [] { return pendulum.graph()->size() + pendulum_by_L.graph()->size(); };
  const std::size_t before = size();
  for (const Form& form : all_forms()) {
    INFO(form.reported);
    const auto scheme = make(form);
    REQUIRE(scheme->advance(first_step, 0.0) == Status::success);
    if (auto* const one_step = dynamic_cast<OneStepScheme*>(scheme.get())) {
      std::vector<double> columns = {1.0, 0.0, 0.0, 1.0};
      static_cast<void>(one_step->tangent(columns));
    }
    static_cast<void>(scheme->energy_size());
    static_cast<void>(scheme->node());
    CHECK(size() == before);
  }
  static_cast<void>(separate(pendulum));  // a twin
  CHECK(size() > before);
}

TEST_CASE("every scheme for orbits has the order that it says") {
  for (const Form& form : all_forms()) {
    if (method_of(form.scheme).name == "forward") {
      continue;  // unstable: nothing is left after these steps
    }
    INFO(form.reported);
    const int order = make(form)->order();
    double coarse = 0.0, fine = 0.0;
    for (const int first : {4, 2}) {  // fewer steps where those err too little
      std::vector<std::vector<double>> ends;
      for (const int steps : {first, 2 * first, 4 * first}) {
        const double h = 1.6 / steps;
        const auto scheme = make(form, h);
        ends.push_back(after(*scheme, h, steps));
      }
      coarse = distance(ends[0], ends[1]);
      fine = distance(ends[1], ends[2]);
      if (fine >= 1e-11) {
        break;
      }
    }
    INFO(order << ": " << coarse << " " << fine);
    if (fine < 1e-11) {
      CHECK(order >= 8);  // rounding is near before a slope is seen
      continue;
    }
    const double slope = std::log2(coarse / fine), margin = 0.15 * order + 0.15;
    // Of Blanes and Moan's composition of Nyström's kind the leading term is small: at these steps that of h⁸ shows.
    const auto* splitting = std::get_if<Splitting>(&form.scheme);
    const bool next_shows = splitting != nullptr && splitting->composition == "blanes-moan-rkn-6";
    CHECK(slope > order - margin);
    CHECK(slope < order + (next_shows ? 2 : 0) + margin);
  }
}

TEST_CASE("every scheme for orbits tells the slope of its discrete energy, to leading order at least") {
  for (const Form& form : all_forms()) {
    INFO(form.reported);
    const double h = make(form)->order() > 4 ? 0.8 : 0.2, change = 1e-3 * h;
    const auto energy_at = [&](double length) {
      const auto scheme = make(form, h);
      REQUIRE(scheme->advance(length, 0.0) == Status::success);
      return scheme->discrete_energy();
    };
    const auto scheme = make(form, h);
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    const double difference = (energy_at(h + change) - energy_at(h - change)) / (2 * change);
    // To leading order it is off by a factor 1 + O(h); else by what the matrix of an iteration before the last one
    // leaves, 1 + O(h²). Rounding of E ~ 1 moves the difference.
    const double share = scheme->slope_to_leading_order() ? 0.5 : 0.1 * h * h;
    CHECK(scheme->discrete_energy_slope() == Approx(difference).epsilon(share).margin(1e-14 / change));
    CHECK_FALSE(scheme->discrete_energy_slope() == Approx(-difference).epsilon(share));  // the twin
  }
}

TEST_CASE("every scheme for orbits that states an action makes it stationary, and has its energy, from any state") {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  for (const Form& form : all_forms()) {
    if (form.by_L || method_of(form.scheme).is_map()) {
      continue;  // a quadrature of L's action, or a family of maps that its K generates: families_test, lagrangian_test
    }
    INFO(form.reported);
    const auto action = make_action(pendulum, form.scheme);
    for (int attempt = 0; attempt < 5; ++attempt) {
      const double z_0[] = {value(random), value(random)};
      const auto scheme = make(form, first_step, z_0);
      double t = scheme->state()[0] == z_0[0] ? 0.0 : first_step;  // where the two-step form begins with a pair
      std::vector<double> corners[2];
      Eigen::VectorXd gradient(6);
      for (std::size_t k = 0; k < 2; ++k) {
        const double h = k == 0 && method_of(form.scheme).name != "forward" ? 0.13 : first_step;
        corners[k] = {t, scheme->state()[0], scheme->state()[1]};
        REQUIRE(scheme->advance(h, 0.0) == Status::success);
        const double energy = scheme->discrete_energy();
        scheme->accept();
        t += h;
        corners[k].insert(corners[k].end(), {t, scheme->state()[0], scheme->state()[1]});
        action->gradient(corners[k], gradient);
        CHECK(gradient[0] == Approx(energy).epsilon(1e-13).margin(1e-13));
      }
      const Incidence both[] = {{corners[0], 1}, {corners[1], 0}};
      const Incidence twin[] = {{corners[0], 1}, {corners[0], 0}};
      // A dozen terms of order 1, to units in the last place; t_1 - t_0 has lost one digit.
      CHECK(value_variation(*action, both).lpNorm<Eigen::Infinity>() < 1e-13);
      CHECK(value_variation(*action, twin).lpNorm<Eigen::Infinity>() > 1e-4);
    }
  }
}
