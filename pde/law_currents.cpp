#include <algorithm>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/law_evaluator.hpp>

namespace rubato {

namespace {

/// out += factor·left·right.
void add_term_of_two(double factor, const double* left, const double* right, std::size_t count, double* out) {
  for (std::size_t c = 0; c < count; ++c) {
    out[c] += factor * left[c] * right[c];
  }
}
void add_term_of_one(double factor, const double* left, std::size_t count, double* out) {
  for (std::size_t c = 0; c < count; ++c) {
    out[c] += factor * left[c];
  }
}

}  // namespace

std::vector<Spread> write_residuals(const grids::FieldSet& of_laws, std::span<double* const> residuals) {
  for (std::size_t l = 0; l < residuals.size(); ++l) {
    std::ranges::copy(of_laws.field(static_cast<int>(l)), residuals[l]);
  }
  return grids::magnitudes(of_laws);
}

std::vector<LawTerm> LawTables::terms_of_currents(int mu, bool has_partner) const {
  using Kind = LawQuantity::Kind;
  const Kind partner = has_partner ? Kind::partner : Kind::field;
  std::vector<LawTerm> terms;
  for (int nu = 0; nu < directions; ++nu) {
    const auto law = static_cast<std::size_t>(nu);
    if (nu > 0 && !ramps.empty()) {  // s_ν·∇S, the source that a ramp makes, is the divergence of s_νᵀΛ_μ z
      for (const MatrixTerm& term : ramps[law - 1][static_cast<std::size_t>(mu)]) {
        terms.push_back({.law = law, .factor = -term.value, .left = {Kind::field, term.column}, .of_seam = true});
      }
    }
    if (nu > 0 && !turns.empty()) {  // z_ν = R (z~_ν + G_ν z~)
      for (const MatrixTerm& term : (has_partner ? turns_plus : turns)[law - 1][static_cast<std::size_t>(mu)]) {
        terms.push_back({.law = law,
                         .factor = term.value,
                         .left = {Kind::field, term.row},
                         .right = LawQuantity{partner, term.column},
                         .of_seam = true});
      }
    }
    if (nu != mu) {
      for (const MatrixTerm& term : plus[static_cast<std::size_t>(mu)]) {
        terms.push_back({law, -term.value, {Kind::derivative, term.row, nu}, LawQuantity{partner, term.column}});
      }
      continue;
    }
    terms.push_back({.law = law, .left = {Kind::S}});
    for (int other = 0; other < directions; ++other) {
      for (const MatrixTerm& term : plus[static_cast<std::size_t>(other)]) {
        if (other != nu) {
          terms.push_back(
              {law, term.value, {Kind::derivative, term.row, other}, LawQuantity{Kind::field, term.column}});
        }
      }
    }
  }
  auto law = static_cast<std::size_t>(directions);
  for (const auto& symmetry : has_partner ? quadratic_plus : quadratic) {
    for (const MatrixTerm& term : symmetry[static_cast<std::size_t>(mu)]) {
      terms.push_back({law, term.value, {Kind::field, term.row}, LawQuantity{partner, term.column}});
    }
    ++law;
  }
  for (const auto& symmetry : linear) {
    for (const MatrixTerm& term : symmetry[static_cast<std::size_t>(mu)]) {
      terms.push_back({law, term.value, {Kind::field, term.column}});
    }
    ++law;
  }
  return terms;
}

void LawTables::currents(int mu, std::size_t count, const LawPoints& points, std::span<double* const> out) const {
  const auto values = [&](const LawQuantity& quantity) {
    const auto field = static_cast<std::size_t>(quantity.field);
    switch (quantity.kind) {
      case LawQuantity::Kind::field: return points.z[field];
      case LawQuantity::Kind::partner: return points.partner[field];
      case LawQuantity::Kind::derivative:
        return points.derivatives[field][static_cast<std::size_t>(quantity.direction)];
      case LawQuantity::Kind::S: break;
    }
    return points.S;
  };
  for (double* const to : out) {
    std::fill_n(to, count, 0.0);
  }
  for (const LawTerm& term : terms_[points.partner.empty() ? 0 : 1][static_cast<std::size_t>(mu)]) {
    const double* const left = values(term.left);
    if (term.right) {
      add_term_of_two(term.factor, left, values(*term.right), count, out[term.law]);
    } else {
      add_term_of_one(term.factor, left, count, out[term.law]);
    }
  }
}

}  // namespace rubato
