#include <algorithm>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/law_evaluator.hpp>

namespace rubato {

namespace {

/// out += factor·left·right.
void add_term(double factor, const double* left, const double* right, std::size_t count, double* out) {
  for (std::size_t c = 0; c < count; ++c) {
    out[c] += factor * left[c] * right[c];
  }
}

}  // namespace

std::vector<Spread> tell_residuals(const grids::FieldSet& of_laws, std::span<double* const> residuals) {
  for (std::size_t l = 0; l < residuals.size(); ++l) {
    std::ranges::copy(of_laws.field(static_cast<int>(l)), residuals[l]);
  }
  return grids::magnitudes(of_laws);
}

void LawTables::currents(int mu, std::size_t count, const LawPoints& points, std::span<double* const> out) const {
  const std::span<const double* const> partner = points.partner.empty() ? points.z : points.partner;
  const auto derivative = [&](int f, int nu) {
    return points.derivatives[static_cast<std::size_t>(f)][static_cast<std::size_t>(nu)];
  };
  for (int nu = 0; nu < directions; ++nu) {
    double* to = out[static_cast<std::size_t>(nu)];
    if (nu != mu) {
      std::fill_n(to, count, 0.0);
      for (const MatrixTerm& term : plus[static_cast<std::size_t>(mu)]) {
        add_term(-term.value, derivative(term.row, nu), partner[static_cast<std::size_t>(term.column)], count, to);
      }
      continue;
    }
    std::copy_n(points.S, count, to);
    for (int other = 0; other < directions; ++other) {
      if (other != nu) {
        for (const MatrixTerm& term : plus[static_cast<std::size_t>(other)]) {
          add_term(term.value, derivative(term.row, other), points.z[static_cast<std::size_t>(term.column)], count, to);
        }
      }
    }
  }
  symmetry_currents(mu, count, points.z, points.partner, out.subspan(static_cast<std::size_t>(directions)));
}

void LawTables::symmetry_currents(int mu, std::size_t count, std::span<const double* const> z,
                                  std::span<const double* const> partner, std::span<double* const> out) const {
  const auto direction = static_cast<std::size_t>(mu);
  std::size_t law = 0;
  for (const auto& symmetry : partner.empty() ? quadratic : quadratic_plus) {
    double* to = out[law++];
    std::fill_n(to, count, 0.0);
    for (const MatrixTerm& term : symmetry[direction]) {
      const double* left = z[static_cast<std::size_t>(term.row)];
      const double* right = (partner.empty() ? z : partner)[static_cast<std::size_t>(term.column)];
      for (std::size_t c = 0; c < count; ++c) {
        to[c] += term.value * left[c] * right[c];
      }
    }
  }
  for (const auto& symmetry : linear) {
    double* to = out[law++];
    std::fill_n(to, count, 0.0);
    for (const MatrixTerm& term : symmetry[direction]) {
      const double* field = z[static_cast<std::size_t>(term.column)];
      for (std::size_t c = 0; c < count; ++c) {
        to[c] += term.value * field[c];
      }
    }
  }
}

}  // namespace rubato
