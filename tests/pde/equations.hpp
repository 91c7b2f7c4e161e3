#pragma once

#include <cmath>
#include <functional>
#include <string>
#include <tuple>
#include <vector>

#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

/// The equations of the tests, in the multisymplectic forms of the catalogue.
namespace rubato::tests {

using Triple = std::tuple<const char*, const char*, double>;

inline MultisymplecticSystem make_system(const std::vector<std::string>& fields, const std::vector<Triple>& M,
                                         const std::vector<std::vector<Triple>>& K, const std::string& S,
                                         const MultisymplecticSystem::Parameters& parameters = {}) {
  const auto matrix = [&](const std::vector<Triple>& triples) {
    const auto d = static_cast<Eigen::Index>(fields.size());
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(d, d);
    const auto index = [&](const std::string& name) {
      return static_cast<Eigen::Index>(std::find(fields.begin(), fields.end(), name) - fields.begin());
    };
    for (const auto& [row, column, value] : triples) {
      result(index(row), index(column)) = value;
      result(index(column), index(row)) = -value;
    }
    return result;
  };
  std::vector<Eigen::MatrixXd> directions;
  for (const auto& triples : K) {
    directions.push_back(matrix(triples));
  }
  return {fields, matrix(M), directions, S, parameters};
}

/// u_tt = u_xx - V'(u), S = ½(v² - w²) + V(u).
inline MultisymplecticSystem wave_equation(const std::string& V) {
  return make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "(v^2 - w^2)/2 + " + V);
}
inline MultisymplecticSystem sine_gordon() {
  return wave_equation("1 - cos(u)");
}
inline MultisymplecticSystem wave_equation_2d(const std::string& V) {
  return make_system({"u", "v", "a", "b"}, {{"u", "v", -1}}, {{{"u", "a", 1}}, {{"u", "b", 1}}},
                     "(v^2 - a^2 - b^2)/2 + " + V);
}
/// iψ_t + ψ_xx + a|ψ|²ψ = 0.
inline MultisymplecticSystem schroedinger(double a) {
  return make_system({"p", "q", "v", "w"}, {{"p", "q", 1}}, {{{"p", "v", -1}, {"q", "w", -1}}},
                     "(v^2 + w^2)/2 + a/4*(p^2 + q^2)^2", {{"a", a}});
}
/// u_t + ηuu_x + γ²u_xxx = 0.
inline MultisymplecticSystem korteweg_de_vries(double eta, double gamma) {
  return make_system({"phi", "u", "v", "w"}, {{"phi", "u", 0.5}}, {{{"phi", "w", 1}, {"u", "v", -gamma}}},
                     "v^2/2 - u*w + eta*u^3/6", {{"eta", eta}});
}
/// u_t + αu_x + guu_x - σu_xxt = 0.
inline MultisymplecticSystem benjamin_bona_mahony(double alpha, double g, double sigma) {
  return make_system({"phi", "u", "v", "w", "p"}, {{"phi", "u", 0.5}, {"u", "v", 0.5 * sigma}},
                     {{{"phi", "p", 1}, {"u", "w", 0.5 * sigma}}}, "alpha*u^2/2 + g*u^3/6 - p*u - sigma/2*v*w",
                     {{"alpha", alpha}, {"g", g}, {"sigma", sigma}});
}
inline MultisymplecticSystem camassa_holm(double gamma) {
  return make_system({"u", "phi", "w", "v", "nu"}, {{"u", "phi", 0.5}, {"u", "nu", -0.5}},
                     {{{"u", "v", -1}, {"phi", "w", 1}}}, "-w*u - u^3/2 - gamma*u*nu^2/2 + nu*v", {{"gamma", gamma}});
}
/// φ_tt = (u + u² - u_xx)_x, u = φ_x.
inline MultisymplecticSystem good_boussinesq() {
  return make_system({"phi", "u", "v", "w", "p"}, {{"phi", "v", -1}}, {{{"phi", "p", 1}, {"u", "w", 1}}},
                     "v^2/2 - w^2/2 + u^2/2 + u^3/3 - p*u");
}
inline MultisymplecticSystem dirac(double m, double lambda) {
  return make_system({"p1", "q1", "p2", "q2"}, {{"p1", "q1", 1}, {"p2", "q2", 1}}, {{{"p1", "q2", 1}, {"p2", "q1", 1}}},
                     "-m/2*(p1^2 + q1^2 - p2^2 - q2^2) + lambda/2*(p1^2 + q1^2 - p2^2 - q2^2)^2",
                     {{"m", m}, {"lambda", lambda}});
}
/// u_t + uu_x + u_xxx + u_xyy = 0.
inline MultisymplecticSystem zakharov_kuznetsov() {
  return make_system({"phi", "u", "v", "w", "p"}, {{"phi", "u", 0.5}},
                     {{{"phi", "p", 1}, {"u", "v", -1}}, {{"u", "w", -1}}}, "u^3/6 - p*u + (v^2 + w^2)/2");
}

using Profile = std::function<double(double)>;

/// Node values of a function of x.
inline std::vector<double> sampled(const grids::Grid& grid, const Profile& f) {
  std::vector<double> values;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    values.push_back(f(grid.axis(0).node(i)));
  }
  return values;
}

inline double sech(double x) {
  return 1.0 / std::cosh(x);
}

inline double largest_difference(std::span<const double> a, std::span<const double> b) {
  double result = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    result = std::max(result, std::abs(a[i] - b[i]));
  }
  return result;
}

}  // namespace rubato::tests
