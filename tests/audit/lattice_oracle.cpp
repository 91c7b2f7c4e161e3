#include "audit/lattice_oracle.hpp"

#include <algorithm>
#include <cmath>

namespace audit {

namespace {

using Lagrangian = LatticeProblem::Lagrangian;

const Bounded half = 0.5L;
const long double pi = std::acos(-1.0L);

LatticeState combined(const LatticeState& a, const LatticeState& b, const Bounded& factor_a, const Bounded& factor_b) {
  LatticeState result = a;
  for (std::size_t f = 0; f < a.size(); ++f) {
    for (std::size_t i = 0; i < a[f].size(); ++i) {
      result[f][i] = factor_a * a[f][i] + factor_b * b[f][i];
    }
  }
  return result;
}

long double largest(const Values& values) {
  long double most = 0.0L;
  for (const Bounded& value : values) {
    most = std::max(most, std::abs(value.value));
  }
  return most;
}

Bounded exact(double value) {
  return {static_cast<long double>(value)};
}

}  // namespace

LatticeOracle::LatticeOracle(const LatticeProblem& problem) : problem_(problem) {
  // The derivative of the trigonometric interpolant of a unit pulse at node 0, at node j; its Nyquist mode counts as 0.
  for (const Axis& axis : problem.axes) {
    std::vector<Bounded> column(axis.cells);
    const auto count = static_cast<long double>(axis.cells);
    for (std::size_t j = 1; j < axis.cells; ++j) {
      const long double angle = pi * static_cast<long double>(j) / count;
      const long double kernel = axis.cells % 2 == 1 ? 1 / std::sin(angle) : 1 / std::tan(angle);
      const long double value = (j % 2 == 0 ? 1 : -1) * pi / static_cast<long double>(axis.length()) * kernel;
      column[j] = {value, unit_roundoff * std::abs(value)};
    }
    interpolation_.push_back(std::move(column));
  }
}

LatticeState LatticeOracle::state(std::span<const std::vector<double>> fields) const {
  LatticeState state;
  long double most = 0.0L;
  for (const std::vector<double>& field : fields) {
    Values values;
    for (const double value : field) {
      values.push_back(Bounded::stored(value));
    }
    most = std::max(most, largest(values));
    state.push_back(std::move(values));
  }
  // ‖A⁻¹D‖ = 4N/(πΔx) for averages over cells, π/Δx in Fourier space; a potential is an integral over the length.
  for (std::size_t f = 0; f < state.size(); ++f) {
    if (problem_.slaved[f]) {
      for (Bounded& value : state[f]) {
        long double gain = 0.0L;
        for (const Axis& axis : problem_.axes) {
          const auto width = static_cast<long double>(axis.width());
          gain += problem_.potential == f ? static_cast<long double>(axis.length())
                  : cells()               ? 4 * static_cast<long double>(axis.cells) / (pi * width)
                                          : pi / width;
        }
        value.error += unit_roundoff * gain * most;
      }
    }
  }
  return state;
}

std::size_t LatticeOracle::neighbour(std::size_t node, std::size_t axis, int direction) const {
  const std::size_t stride = axis == 0 ? 1 : problem_.axes[0].cells;
  const std::size_t count = problem_.axes[axis].cells;
  const std::size_t place = node / stride % count;
  const std::size_t next = (place + count + static_cast<std::size_t>(direction + static_cast<int>(count))) % count;
  return node + next * stride - place * stride;
}

Values LatticeOracle::averaged(const Values& values, std::size_t axis) const {
  Values result;
  for (std::size_t i = 0; i < values.size(); ++i) {
    result.push_back(half * (values[i] + values[neighbour(i, axis, 1)]));
  }
  return result;
}

Values LatticeOracle::differenced(const Values& values, std::size_t axis) const {
  Values result;
  for (std::size_t i = 0; i < values.size(); ++i) {
    result.push_back((values[neighbour(i, axis, 1)] - values[i]) / exact(problem_.axes[axis].width()));
  }
  return result;
}

Values LatticeOracle::spectral(const Values& values, std::size_t axis) const {
  const std::size_t stride = axis == 0 ? 1 : problem_.axes[0].cells;
  const std::size_t count = problem_.axes[axis].cells;
  Values result(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t place = i / stride % count, first = i - place * stride;
    for (std::size_t j = 0; j < count; ++j) {
      result[i] += interpolation_[axis][(place + count - j) % count] * values[first + j * stride];
    }
  }
  return result;
}

LatticeState LatticeOracle::means(const LatticeState& state, std::size_t except) const {
  LatticeState result = state;
  for (Values& field : result) {
    for (std::size_t a = 0; cells() && a < problem_.axes.size(); ++a) {
      field = a == except ? field : averaged(field, a);
    }
  }
  return result;
}

LatticeState LatticeOracle::slopes(const LatticeState& state, std::size_t axis) const {
  LatticeState result;
  for (const Values& field : state) {
    Values slope = cells() ? differenced(field, axis) : spectral(field, axis);
    for (std::size_t a = 0; cells() && a < problem_.axes.size(); ++a) {
      slope = a == axis ? slope : averaged(slope, a);
    }
    result.push_back(std::move(slope));
  }
  if (problem_.potential) {
    for (Bounded& value : result[*problem_.potential]) {
      value = value + slope_;
    }
  }
  return result;
}

void LatticeOracle::set_slope(const LatticeState& first) {
  if (problem_.potential) {
    Bounded sum = 0.0L;
    for (const Bounded& value : first[problem_.derivative_of_potential]) {
      sum += value;
    }
    slope_ = sum / Bounded(static_cast<long double>(problem_.nodes()));
  }
}

Bounded LatticeOracle::volume() const {
  Bounded volume = 1.0L;
  for (const Axis& axis : problem_.axes) {
    volume = volume * exact(axis.width());
  }
  return volume;
}

Values LatticeOracle::S(const LatticeState& state) const {
  Values result;
  std::vector<Bounded> z(state.size());
  for (std::size_t i = 0; i < state[0].size(); ++i) {
    for (std::size_t f = 0; f < state.size(); ++f) {
      z[f] = state[f][i];
    }
    result.push_back(problem_.S(std::span<const Bounded>(z)));
  }
  return result;
}

LatticeState LatticeOracle::gradient(const LatticeState& state) const {
  const Shape& shape = Shape::of(state.size(), 1);
  LatticeState result(state.size());
  for (std::size_t i = 0; i < state[0].size(); ++i) {
    std::vector<Series> z;
    for (std::size_t f = 0; f < state.size(); ++f) {
      z.emplace_back(shape, state[f][i], f);
    }
    const Series S = problem_.S(std::span<const Series>(z));
    for (std::size_t f = 0; f < state.size(); ++f) {
      result[f].push_back(S.derivative(f));
    }
  }
  return result;
}

LatticeState LatticeOracle::residual(const LatticeState& before, const LatticeState& after, double h) const {
  if (problem_.lagrangian == Lagrangian::euler_box) {
    return euler_residual(before, after, h);
  }
  const Bounded inverse = Bounded(1.0L) / Bounded::stored(h);
  const LatticeState middle = combined(before, after, half, half);
  const LatticeState rates = means(combined(before, after, -inverse, inverse));
  LatticeState rows = gradient(means(middle));
  for (Values& row : rows) {
    for (Bounded& value : row) {
      value = -value;
    }
  }
  const auto add = [&](const std::vector<MatrixEntry>& matrix, const LatticeState& derivative) {
    for (const auto& [row, column, value] : matrix) {
      for (std::size_t i = 0; i < rows[row].size(); ++i) {
        rows[row][i] += exact(value) * derivative[column][i];
        rows[column][i] += exact(-value) * derivative[row][i];
      }
    }
  };
  add(problem_.M, rates);
  for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
    add(problem_.K[a], slopes(middle, a));
  }
  return rows;
}

LatticeState LatticeOracle::euler_residual(const LatticeState& before, const LatticeState& after, double h) const {
  const Bounded inverse = Bounded(1.0L) / Bounded::stored(h);
  const LatticeState rates = combined(before, after, -inverse, inverse);
  // ∇S - K₊δ⁺z + K₊ᵀδ⁻z of a level
  const auto forces = [this](const LatticeState& level) {
    LatticeState rows = gradient(level);
    for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
      for (const auto& [row, column, value] : problem_.K[a]) {
        const Values forward = differenced(level[column], a), slope = differenced(level[row], a);
        for (std::size_t i = 0; i < forward.size(); ++i) {
          rows[row][i] += exact(-value) * forward[i];
          rows[column][i] += exact(value) * slope[neighbour(i, a, -1)];
        }
      }
    }
    return rows;
  };
  const LatticeState first = forces(before);
  LatticeState rows = forces(after);
  for (const auto& [row, column, value] : problem_.M) {
    rows[row] = first[row];  // a row of M₊ holds at the level before, the others at the one after
  }
  for (const auto& [row, column, value] : problem_.M) {
    for (std::size_t i = 0; i < rows[row].size(); ++i) {
      rows[row][i] += exact(-value) * rates[column][i];
      rows[column][i] += exact(value) * rates[row][i];
    }
  }
  return rows;
}

/// S + Σ (D_a z)ᵀK₊z in cells, or at nodes; euler-box has S - Σ zᵀK₊δ⁺z. Fields of midpoints only drop out of it, and
/// are taken as 0.
Values LatticeOracle::energy_density(const LatticeState& level) const {
  LatticeState state = level;
  for (std::size_t f = 0; f < state.size(); ++f) {
    if (problem_.midpoint_only[f]) {
      std::ranges::fill(state[f], Bounded());
    }
  }
  const bool euler = one_sided();
  const LatticeState mean = means(state);
  Values density = S(mean);
  for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
    for (const auto& [row, column, value] : problem_.K[a]) {
      const Values slope = euler ? differenced(state[column], a) : Values();
      const LatticeState slope_of_all = euler ? LatticeState() : slopes(state, a);
      for (std::size_t i = 0; i < density.size(); ++i) {
        density[i] +=
            euler ? exact(-value) * state[row][i] * slope[i] : exact(value) * slope_of_all[row][i] * mean[column][i];
      }
    }
  }
  return density;
}

bool LatticeOracle::one_sided() const {
  return problem_.lagrangian == Lagrangian::euler_box || problem_.differences;
}

Bounded LatticeOracle::node_energy(const LatticeState& level) const {
  Bounded sum = 0.0L;
  for (const Bounded& value : energy_density(level)) {
    sum += value;
  }
  return volume() * sum;
}

long double LatticeOracle::magnitude_of_terms(const LatticeState& level) const {
  LatticeState state = means(level);
  long double sum = 0.0L;
  std::vector<Bounded> z(state.size());
  for (std::size_t i = 0; i < state[0].size(); ++i) {
    for (std::size_t f = 0; f < state.size(); ++f) {
      z[f] = problem_.midpoint_only[f] ? Bounded() : state[f][i];
    }
    sum += problem_.S.sum_of_magnitudes(std::span<const Bounded>(z));
  }
  for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
    const LatticeState slope = slopes(level, a);
    for (const auto& [row, column, value] : problem_.K[a]) {
      for (std::size_t i = 0; i < slope[row].size(); ++i) {
        sum += problem_.midpoint_only[column] ? 0.0L : std::abs(value * slope[row][i].value * state[column][i].value);
      }
    }
  }
  return sum * volume().value;
}

Bounded LatticeOracle::energy(const LatticeState& before, const LatticeState& after) const {
  return problem_.lagrangian == Lagrangian::euler_box ? node_energy(before)
                                                      : node_energy(combined(before, after, half, half));
}

FluxPlace LatticeOracle::middle_of(const LatticeState& before, const LatticeState& after, double h) const {
  const Bounded inverse = Bounded(1.0L) / Bounded::stored(h);
  return {1.0L, combined(before, after, half, half), combined(before, after, -inverse, inverse)};
}

Values LatticeOracle::energy_law(const LatticeState& before, const LatticeState& after, double h,
                                 std::span<const FluxPlace> places) const {
  const FluxPlace middle_place = places.empty() ? middle_of(before, after, h) : FluxPlace();
  places = places.empty() ? std::span(&middle_place, 1) : places;
  const Bounded inverse = Bounded(1.0L) / Bounded::stored(h);
  const Values first = energy_density(before), last = energy_density(after);
  Values law;
  for (std::size_t i = 0; i < first.size(); ++i) {
    law.push_back((last[i] - first[i]) * inverse);
  }
  for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
    // On the faces across a: F = -(D_t z)ᵀK₊ A_t z
    Values flux(law.size());
    for (const FluxPlace& place : places) {
      const LatticeState face = means(place.state, a), face_rate = means(place.rate, a);
      for (const auto& [row, column, value] : problem_.K[a]) {
        for (std::size_t i = 0; i < flux.size(); ++i) {
          flux[i] += Bounded(place.weight) * exact(-value) * face_rate[row][i] * face[column][i];
        }
      }
    }
    const Values change = cells() ? differenced(flux, a) : spectral(flux, a);
    for (std::size_t i = 0; i < law.size(); ++i) {
      law[i] += change[i];
    }
  }
  return law;
}

/// I = -(D_x z)ᵀM₊z in cells of a line
Bounded LatticeOracle::momentum(const LatticeState& level) const {
  const LatticeState mean = means(level), slope = slopes(level, 0);
  Bounded sum = 0.0L;
  for (const auto& [row, column, value] : problem_.M) {
    for (std::size_t i = 0; i < mean[column].size(); ++i) {
      sum += exact(-value) * slope[row][i] * mean[column][i];
    }
  }
  return volume() * sum;
}

Values LatticeOracle::momentum_law(const LatticeState& before, const LatticeState& after, double h,
                                   std::span<const FluxPlace> places) const {
  const FluxPlace middle_place = places.empty() ? middle_of(before, after, h) : FluxPlace();
  places = places.empty() ? std::span(&middle_place, 1) : places;
  const Bounded inverse = Bounded(1.0L) / Bounded::stored(h);
  const auto density = [this](const LatticeState& level) {
    const LatticeState mean = means(level), slope = slopes(level, 0);
    Values values(mean[0].size());
    for (const auto& [row, column, value] : problem_.M) {
      for (std::size_t i = 0; i < values.size(); ++i) {
        values[i] += exact(-value) * slope[row][i] * mean[column][i];
      }
    }
    return values;
  };
  const Values first = density(before), last = density(after);
  // G = S(A_t z) + (D_t z)ᵀM₊ A_t z at the nodes
  Values flux(first.size());
  for (const FluxPlace& place : places) {
    const Bounded weight = place.weight;
    const Values density_of_place = S(place.state);
    for (std::size_t i = 0; i < flux.size(); ++i) {
      flux[i] += weight * density_of_place[i];
    }
    for (const auto& [row, column, value] : problem_.M) {
      for (std::size_t i = 0; i < flux.size(); ++i) {
        flux[i] += weight * exact(value) * place.rate[row][i] * place.state[column][i];
      }
    }
  }
  Values law = cells() ? differenced(flux, 0) : spectral(flux, 0);
  for (std::size_t i = 0; i < law.size(); ++i) {
    law[i] += (last[i] - first[i]) * inverse;
  }
  return law;
}

}  // namespace audit
