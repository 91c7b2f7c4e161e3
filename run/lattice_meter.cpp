#include <rubato/run/lattice_meter.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>

#include <rubato/base/larger.hpp>
#include <rubato/formula/branches.hpp>
#include <rubato/grids/lines.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/action_consistency.hpp>
#include <rubato/pde/natural_sizes.hpp>
#include <rubato/pde/periodicity.hpp>
#include <rubato/pde/well_posedness.hpp>
#include <rubato/problem/grid_sampling.hpp>

namespace rubato {

namespace {

/// A field with less than this part of the energy is rounding errors.
constexpr double least_energy = 1e-10;
/// The highest wave that counts has so much of the energy.
constexpr double counting_wave = 1e-3;
/// A field that is smaller than this at the seam, of its largest, is at rest there; larger than that it has come there.
constexpr double at_rest = 1e-4, arrived = 1e-2;

void raise(double value, double t, double& largest, double& when) {
  if (value > largest || (std::isnan(largest) && std::isfinite(value))) {
    largest = value;
    when = t;
  }
}

bool names_noise(const Problem& problem) {
  const auto names_it = [](const FormulaText& formula) { return formula.text.find("noise(") != std::string::npos; };
  return std::ranges::any_of(problem.multisymplectic()->initial,
                             [&](const auto& formula) { return formula && names_it(*formula); }) ||
         std::ranges::any_of(problem.parameters,
                             [&](const Parameter& one) { return one.definition && names_it(*one.definition); });
}

/// Measures::action.
double off_equation(const MultisymplecticSystem& system, const CornerDensity& density, const LatticeLevel& first) {
  StatedAction stated = state_action(system, density);
  stated.typical = typical_values(first);
  const ActionConsistency found = consistency_of(system, stated);
  return found.is_tested || !found.wrong.empty() ? found.off : figures::Measures::none;
}

/// On other branches, where formulas differ that differ anywhere.
MultisymplecticSystem on_branches(const MultisymplecticSystem& system, double scale) {
  auto graph = std::make_shared<formula::Graph>();
  std::vector<Eigen::MatrixXd> K;
  for (int a = 0; a < system.directions(); ++a) {
    K.push_back(system.K(a));
  }
  const formula::Expression S = formula::on_other_branches(std::array{system.expression()}, *graph, scale).front();
  const MultisymplecticSystem result(graph, system.fields(), system.M(), K, S);
  const std::vector<bool> at_midpoints = system.structure().at_midpoints();
  return std::ranges::find(at_midpoints, true) == at_midpoints.end() ? result.at_levels() : result;
}
CornerDensity on_branches(CornerDensity density, double scale) {
  density.L = formula::on_other_branches(std::array{density.L}, *density.graph, scale).front();
  return density;
}

}  // namespace

LatticeMeter::LatticeMeter(const Problem& problem, const MultisymplecticSystem& system, const grids::Grid& grid,
                           const LatticeLevel& first, const Mirrors* mirrors)
    : system_(system), mirrors_(mirrors), grid_(mirrors == nullptr ? grid : mirrors->ring()) {
  for (int f = 0; f < system.field_count(); ++f) {
    moves_.push_back(!system.M().row(f).isZero(0.0) && !system.structure().at_midpoints(f));
  }
  is_driven_ = problem.multisymplectic()->has_drives();
  const Scheme& scheme = problem.scheme;
  const bool by_waves = scheme.method == "fourier" || (scheme.method == "splitting" && scheme.space == "fourier");
  // Differences of neighbours on a spacing of 1 are the equation of a chain.
  const bool is_chain =
      !by_waves && std::ranges::all_of(grid.axes(), [](const grids::Axis& axis) { return axis.spacing() == 1.0; });
  rough_ = is_chain || names_noise(problem);
  between_nodes_ =
      rough_ ? between_nodes_ : lost_between_nodes(problem, system, grids::whole_of(grid), typical_values(first));
  freezes_alternating_ = by_waves;
  moves_waves_exactly_ = scheme.method == "splitting";
  if (scheme.density != nullptr) {
    action_ = off_equation(system.without_constant(), *scheme.density, first);
    for (const double scale : formula::branch_scales) {
      if (!formula::have_one_branch(std::array{system.expression()}) ||
          !formula::have_one_branch(std::array{scheme.density->L})) {
        const double off =
            off_equation(on_branches(system.without_constant(), scale), on_branches(*scheme.density, scale), first);
        action_ = std::isnan(off) ? action_ : larger(off, std::isnan(action_) ? 0.0 : action_);
      }
    }
  }
  if (!system.coordinates().empty()) {
    const std::span<const formula::Expression> fields =
        std::span(system.variables()).first(static_cast<std::size_t>(system.field_count()));
    gradient_.emplace(system.graph(), formula::gradient(system.expression(), fields), system.fields(), own_grid());
  }
}

void LatticeMeter::read_line(int field, std::span<const double> values, int axis, const grids::Line& at,
                             std::span<double> line) const {
  if (mirrors_ == nullptr) {
    at.read(values.data(), line);
  } else {
    mirrors_->read_line(field, values, axis, at.first, Mirrors::Slope::left_out, line);
  }
}

LatticeMeter::Spectrum LatticeMeter::spectrum_of(int field, std::span<const double> values) {
  const auto nodes = static_cast<double>(grid_.size());
  // About one of the values, so that what cancels is less than the power times the number of nodes.
  const double base = values.front();
  const std::vector<grids::Line> lines = grids::lines_along(grid_, 0);
  const std::size_t n = grid_.cells(0), together = std::max<std::size_t>(1, 16 * grids::nodes_per_block / n);
  std::vector<std::array<CompensatedSum, 2>> parts((lines.size() + together - 1) / together);  // values and squares
  grids::for_each_block(lines.size(), together, [&](std::size_t begin, std::size_t end) {
    grids::LaneSum sums, squares;
    std::vector<double> line(n);
    for (std::size_t number = begin; number < end; ++number) {
      read_line(field, values, 0, lines[number], line);
      std::ranges::for_each(line, [base](double& value) { value -= base; });
      sums.add(line);
      squares.add_squares(line);
    }
    parts[begin / together] = {sums.total(), squares.total()};
  });
  std::array<CompensatedSum, 2> total;
  for (const auto& part : parts) {
    total[0].add(part[0]);
    total[1].add(part[1]);
  }
  const double sum = total[0].value();
  Spectrum spectrum{
      .sum = sum + nodes * base, .power = std::max(0.0, nodes * total[1].value() - sum * sum), .along = {}};
  double not_last = 1.0, not_alternating = 1.0;  // shares of the waves that are so along no axis
  for (int a = 0; a < grid_.dimensions(); ++a) {
    const std::vector<double>& along = spectrum.along.emplace_back(powers_along(a, field, values));
    double last = 0.0;
    for (std::size_t k = 1; k < along.size(); ++k) {
      last += 3 * k > grid_.cells(a) ? along[k] : 0.0;
    }
    const double alternating = grid_.cells(a) % 2 == 0 ? along.back() : 0.0;
    not_last *= 1.0 - std::min(last / spectrum.power, 1.0);
    not_alternating *= 1.0 - std::min(alternating / spectrum.power, 1.0);
  }
  if (spectrum.power > 0.0) {
    spectrum.last = (1.0 - not_last) * spectrum.power;
    spectrum.alternating = (1.0 - not_alternating) * spectrum.power;
  }
  return spectrum;
}

/// The powers of the waves along an axis: of all its lines, or of some at equal distances, in place of all.
std::vector<double> LatticeMeter::powers_along(int axis, int field, std::span<const double> values) {
  constexpr std::size_t most_nodes = std::size_t{1} << 16;
  const std::size_t n = grid_.cells(axis);
  const std::vector<grids::Line> lines = grids::lines_along(grid_, axis);
  const std::size_t taken = std::clamp<std::size_t>(most_nodes / n, 1, lines.size());
  auto& waves = waves_[static_cast<std::size_t>(axis)];
  if (!waves) {
    grids::Axis line = grid_.axis(axis);
    line.left = line.right = grids::End::periodic;
    waves.emplace(grids::Grid({line}), 1);
  }
  const auto all = static_cast<double>(lines.size()), to_all = all / static_cast<double>(taken) * all;
  std::vector<double> line(n), powers(n / 2 + 1, 0.0);
  const double* const arrays[] = {line.data()};
  for (std::size_t number = 0; number < taken; ++number) {
    read_line(field, values, axis, lines[number * lines.size() / taken], line);
    waves->forward(arrays);
    for (std::size_t k = 0; k < powers.size(); ++k) {
      // Half of the modes are kept: the others are their conjugates.
      powers[k] += to_all * std::norm(waves->at(0, k)) * (k == 0 || 2 * k == n ? 1.0 : 2.0);
    }
  }
  return powers;
}

/// S'' at the state whose fields have their root mean squares, with the signs of their means, in the middle of the
/// domain: exp(u) is another one at -u.
Eigen::MatrixXd LatticeMeter::hessian_of(const std::vector<Spectrum>& spectra) const {
  std::vector<double> sizes;
  const auto nodes = static_cast<double>(grid_.size());
  for (const Spectrum& spectrum : spectra) {
    sizes.push_back(std::copysign(std::sqrt(spectrum.sum * spectrum.sum + spectrum.power) / nodes, spectrum.sum));
  }
  return hessian_of_sizes(system_, grid_, sizes);
}

/// A field has no waves where they are rounding, of what its values or those of other fields are sums of.
void LatticeMeter::remove_rounding(std::vector<Spectrum>& spectra, std::span<const double> magnitudes) const {
  const std::vector<double> natural = natural_sizes(system_, grid_, hessian_of(spectra));
  const double rounding = rounding_beside_others * largest_in(natural, magnitudes) * static_cast<double>(grid_.size());
  for (std::size_t f = 0; f < spectra.size(); ++f) {
    Spectrum& spectrum = spectra[f];
    if (!(std::sqrt(spectrum.power) > rounding * natural[f])) {
      spectrum.power = spectrum.last = spectrum.alternating = 0.0;
      for (std::vector<double>& along : spectrum.along) {
        std::ranges::fill(along, 0.0);
      }
    }
  }
}

void LatticeMeter::measure(const LatticeLevel& level, std::span<const double> magnitudes, std::size_t number, double t,
                           double h, figures::Measures& measures, const LatticeLevel* before) {
  const bool is_start = h == 0.0;
  measures.rough = rough_ ? 1.0 : 0.0;
  measures.action = action_;
  measures.between_nodes = is_start ? between_nodes_ : measures.between_nodes;
  const auto count = static_cast<std::size_t>(system_.field_count());
  std::vector<Spectrum> spectra;
  for (int f = 0; f < system_.field_count(); ++f) {
    const bool has_waves = !system_.structure().at_midpoints(f);
    spectra.push_back(has_waves ? spectrum_of(f, level.fields.field(f)) : Spectrum{});
  }
  remove_rounding(spectra, magnitudes);
  const Eigen::MatrixXd hessian = hessian_of(spectra);
  Eigen::MatrixXd weights = hessian.cwiseAbs();
  for (int axis = 0; axis < system_.directions(); ++axis) {
    for (std::size_t g = 0; g < count; ++g) {
      double squares = 0.0;
      if (!spectra[g].along.empty() && spectra[g].power > 0.0) {
        const std::vector<double>& along = spectra[g].along[static_cast<std::size_t>(axis)];
        for (std::size_t k = 1; k < along.size(); ++k) {
          squares += static_cast<double>(k * k) * along[k] / spectra[g].power;
        }
      }
      const double wave_number = 2.0 * std::numbers::pi / grid_.axis(axis).length() * std::sqrt(squares);
      weights.col(static_cast<Eigen::Index>(g)) +=
          wave_number * system_.K(axis).col(static_cast<Eigen::Index>(g)).cwiseAbs();
    }
  }
  std::vector<double> energies(count, 0.0);
  double largest = 0.0;
  for (std::size_t f = 0; f < count; ++f) {
    for (std::size_t g = 0; g < count; ++g) {
      energies[f] += weights(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(g)) * std::sqrt(spectra[f].power) *
                     std::sqrt(spectra[g].power);
    }
    largest = std::max(largest, energies[f]);
  }
  std::vector<bool> counts(count, false);
  for (std::size_t f = 0; f < count; ++f) {
    const Spectrum& spectrum = spectra[f];
    counts[f] = moves_[f] && energies[f] >= least_energy * largest && spectrum.power > 0.0;
    if (!counts[f]) {
      continue;
    }
    // A field that is only about to move, as v at the start from rest, counts by its part.
    const double part = largest > 0.0 ? std::min(1.0, energies[f] / largest) : 1.0;
    raise(part * spectrum.last / spectrum.power, t, measures.waves, measures.waves_t);
    if (is_start && freezes_alternating_) {
      const double share = spectrum.alternating / spectrum.power;
      measures.frozen = std::isnan(measures.frozen) ? share : std::max(measures.frozen, share);
    }
  }
  if (std::has_single_bit(number)) {
    measure_turn(spectra, before == nullptr ? spectra : moving_part(spectra, level, *before), hessian, energies, t, h,
                 measures);
  }
  measure_period(level, counts, t, is_start, measures);
  measure_seam(level, counts, t, is_start, measures);
}

/// The waves that a step changes, each whole where it turns by a quarter or more: its power changes by |1 - exp(iωh)|²
/// of itself then, which is 2.
std::vector<LatticeMeter::Spectrum> LatticeMeter::moving_part(const std::vector<Spectrum>& spectra,
                                                              const LatticeLevel& level, const LatticeLevel& before) {
  std::vector<Spectrum> moving = spectra;
  std::vector<double> change(grid_.size());
  for (std::size_t f = 0; f < moving.size(); ++f) {
    if (!(moving[f].power > 0.0)) {
      continue;
    }
    const auto now = level.fields.field(static_cast<int>(f)), then = before.fields.field(static_cast<int>(f));
    std::ranges::transform(now, then, change.begin(), std::minus());
    for (int a = 0; a < grid_.dimensions(); ++a) {
      const std::vector<double> powers = powers_along(a, static_cast<int>(f), change);
      std::vector<double>& along = moving[f].along[static_cast<std::size_t>(a)];
      std::ranges::transform(along, powers, along.begin(),
                             [](double whole, double part) { return std::min(whole, 0.5 * part); });
    }
  }
  return moving;
}

void LatticeMeter::measure_turn(const std::vector<Spectrum>& spectra, const std::vector<Spectrum>& moving,
                                const Eigen::MatrixXd& hessian, const std::vector<double>& energies, double t, double h,
                                figures::Measures& measures) const {
  if (h == 0.0 || moves_waves_exactly_) {
    return;
  }
  for (int axis = 0; axis < grid_.dimensions(); ++axis) {
    std::vector<double> energy(grid_.cells(axis) / 2 + 1, 0.0);
    double all = 0.0;
    for (std::size_t f = 0; f < spectra.size(); ++f) {
      if (!(spectra[f].power > 0.0)) {
        continue;
      }
      const auto a = static_cast<std::size_t>(axis);
      const double weight = energies[f] / spectra[f].power;
      for (std::size_t k = 1; k < energy.size(); ++k) {
        energy[k] += weight * moving[f].along[a][k];
        all += weight * spectra[f].along[a][k];
      }
    }
    std::size_t highest = energy.size() - 1;
    while (highest > 0 && !(energy[highest] > counting_wave * all)) {
      --highest;
    }
    const double k = 2.0 * std::numbers::pi / grid_.axis(axis).length() * static_cast<double>(highest);
    const Eigen::MatrixXcd B = hessian.cast<std::complex<double>>() -
                               std::complex<double>(0.0, k) * system_.K(axis).cast<std::complex<double>>();
    double fastest = 0.0;
    for (const std::complex<double>& rate : finite_roots(system_.M(), system_.structure().kernel, B)) {
      fastest = std::max(fastest, std::abs(rate));
    }
    const double turn = 2.0 * std::numbers::pi / (fastest * std::abs(h));
    if (std::isfinite(turn) && !(turn >= measures.turn)) {
      measures.turn = turn;
      measures.turn_t = t;
    }
  }
}

void LatticeMeter::measure_period(const LatticeLevel& level, const std::vector<bool>& counts, double t, bool is_start,
                                  figures::Measures& measures) {
  std::vector<double> line;
  const auto look_at = [&](int field, std::span<const double> values, bool is_force) {
    // A wall that drives a field is no mirror of it, and a force of place ends at a wall: nothing has to close there.
    const auto is_open = [&](int axis) {
      const grids::Axis& along = grid_.axis(axis);
      return (is_driven_ || is_force) && (along.left != grids::End::periodic || along.mirrored > 0);
    };
    const double largest = grids::max_abs(values);
    const auto broken = find_seam_break(grid_, largest, [&](int axis, const UseOfLine& use) {
      line.resize(grid_.cells(axis));
      for (const grids::Line& at : is_open(axis) ? std::vector<grids::Line>() : grids::lines_along(grid_, axis)) {
        read_line(field, values, axis, at, line);
        use(line, at.first);
      }
    });
    if (broken) {
      const double slope = broken->jump ? 1.0 : grid_.spacing(broken->axis);
      const double share = std::abs(broken->across) * slope / largest;
      measures.period = measures.period >= share ? measures.period : share;
    }
  };
  if (is_start) {
    for (int f = 0; f < system_.field_count(); ++f) {
      if (counts[static_cast<std::size_t>(f)]) {
        look_at(f, level.fields.field(f), false);
      }
    }
  }
  if (gradient_) {
    const std::vector<std::vector<double>> slopes = (*gradient_)(level, t);
    for (std::size_t f = 0; f < slopes.size(); ++f) {
      if (counts[f] || !moves_[f]) {
        look_at(static_cast<int>(f), slopes[f], true);
      }
    }
  }
}

void LatticeMeter::measure_seam(const LatticeLevel& level, const std::vector<bool>& counts, double t, bool is_start,
                                figures::Measures& measures) const {
  // Where the wave is not at rest at the seam to begin with, it is no pulse in a window.
  if (!is_start && std::isnan(measures.seam)) {
    return;
  }
  double most = 0.0;
  for (int f = 0; f < system_.field_count(); ++f) {
    // A potential has no zero of its own.
    if (!counts[static_cast<std::size_t>(f)] || system_.structure().potential[static_cast<std::size_t>(f)]) {
      continue;
    }
    const std::span<const double> values = level.fields.field(f);
    double beside = 0.0;
    for (int a = 0; a < grid_.dimensions(); ++a) {
      if (grid_.axis(a).mirrored == 0) {
        for (const grids::Line& line : grids::lines_along(own_grid(), a)) {
          beside = std::max(beside, std::abs(values[line.first]));
        }
      }
    }
    most = std::max(most, beside / grids::max_abs(values));
  }
  if (is_start) {
    measures.seam = most < at_rest ? 0.0 : figures::Measures::none;
  } else if (most > arrived) {
    raise(most, t, measures.seam, measures.seam_t);
  }
}

}  // namespace rubato
