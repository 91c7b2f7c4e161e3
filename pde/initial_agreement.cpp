#include <rubato/pde/initial_agreement.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/lines.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/still_waves.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::initial_agreement;

using Eigen::Index;
using Eigen::MatrixXd;
using Values = std::vector<double>;

double second_difference(const Values& line, std::size_t i) {
  const std::size_t n = line.size();
  return std::abs(line[(i + n - 1) % n] - 2.0 * line[i] + line[(i + 1) % n]);
}

/// roughness[i] → max_j roughness[j]·w(|i - j|) round the period, w = 1 next to i and between 1/j² and 4/j² beyond.
void spread(Values& roughness) {
  const std::size_t n = roughness.size();
  Values window(n), wider(n);
  for (std::size_t i = 0; i < n; ++i) {
    window[i] = std::max({roughness[(i + n - 1) % n], roughness[i], roughness[(i + 1) % n]});
  }
  roughness = window;
  for (std::size_t reach = 1; 2 * reach < n; reach *= 2) {
    const double weight = 1.0 / static_cast<double>(reach * reach);
    for (std::size_t i = 0; i < n; ++i) {
      wider[i] = std::max(window[(i + n - reach) % n], window[(i + reach) % n]);
      roughness[i] = std::max(roughness[i], weight * wider[i]);
    }
    window.swap(wider);
  }
}

/// By how much the second differences of a line at the seam exceed those inside.
double seam_excess(const Values& line) {
  const std::size_t n = line.size();
  double inside = 0.0;
  for (std::size_t i = 1; i + 1 < n; ++i) {
    inside = std::max(inside, second_difference(line, i));
  }
  return std::max(0.0, std::max(second_difference(line, 0), second_difference(line, n - 1)) - 2.0 * inside);
}

class Comparison {
public:
  Comparison(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation, int field,
             const InitialFields& given, const LatticeLevel& level, const MatrixXd& rows)
      : system_(system),
        grid_(grid),
        collocation_(collocation),
        field_(field),
        all_(given),
        given_(*given[static_cast<std::size_t>(field)]),
        computed_(level.fields.field(field)),
        slopes_(level.slopes),
        rows_(rows) {}

  void refuse_contradiction() const {
    if (!system_.structure().potential[static_cast<std::size_t>(field_)]) {
      refuse_beyond(cell_means(distance(false)), allowed_for_field());
      return;
    }
    const Values periodic = distance(false);
    if (largest(cell_means(periodic)) > allowed_for_potential(false)) {
      refuse_beyond(cell_means(distance(true)), Values(grid_.size(), allowed_for_potential(true)));
    }
  }

private:
  static double largest(const Values& values) { return grids::max_abs(values); }

  /// The slope of a potential times the distance from the first node.
  [[nodiscard]] double ramp(std::size_t node) const {
    return slopes_.at(field_, node / grid_.cells(0)) * grid_.spacing(0) * static_cast<double>(node % grid_.cells(0));
  }

  /// given - computed; of a potential less what its constraint leaves free, `whole` with its slope.
  [[nodiscard]] Values distance(bool whole) const {
    Values result(grid_.size());
    for (std::size_t i = 0; i < result.size(); ++i) {
      result[i] = given_[i] - computed_[i] - (whole ? ramp(i) : 0.0);
    }
    if (system_.structure().potential[static_cast<std::size_t>(field_)]) {
      remove_free_means(result);
    }
    return result;
  }

  void remove_free_means(Values& values) const {
    std::array<bool, 2> free{};
    for (int a = 1; a < grid_.dimensions(); ++a) {
      free[static_cast<std::size_t>(a) - 1] = solve::annihilates(rows_.transpose().cast<std::complex<double>>(),
                                                                 system_.K(a).col(field_).cast<std::complex<double>>());
    }
    const StillWaves waves(grid_, collocation_, free);
    const std::size_t line = grid_.cells(0);
    const std::size_t lines = grid_.size() / line;
    Values sums(lines, 0.0), members(lines, 0.0);
    for (std::size_t l = 0; l < lines; ++l) {
      sums[waves.group_of(l)] += grids::sum({values.data() + l * line, line});
      members[waves.group_of(l)] += static_cast<double>(line);
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::size_t group = waves.group_of(i / line);
      values[i] -= sums[group] / members[group];
    }
  }

  /// Averages over cells: the discrete constraint fixes those, and they are free of what its inverse amplifies.
  [[nodiscard]] Values cell_means(const Values& values) const {
    grids::BoxOperator average{grids::Along::identity, grids::Along::identity, grids::Along::identity};
    std::fill_n(average.begin(), grid_.dimensions(), grids::Along::average);
    Values mean(values.size());
    grids::apply(grid_, average, values.data(), mean.data());
    return mean;
  }

  [[nodiscard]] double rounding_of_data() const {
    return rounding_share * (largest(given_) + grids::max_abs(computed_));
  }

  [[nodiscard]] Values allowed_for_field() const {
    Values allowed(grid_.size(), rounding_of_data());
    for (int a = 0; a < grid_.dimensions(); ++a) {
      Values line(grid_.cells(a)), roughness(line.size()), other(line.size());
      for (const grids::Line& at : grids::lines_along(grid_, a)) {
        at.read(given_.data(), line);
        const std::size_t n = line.size();
        for (std::size_t i = 0; i < n; ++i) {
          roughness[i] = collocation_ == Collocation::corners
                             ? first_share * std::max(std::abs(line[(i + 1) % n] - line[i]),
                                                      std::abs(line[i] - line[(i + n - 1) % n]))
                             : second_share * second_difference(line, i);
        }
        const double arriving = jump_of_others(a, at, other);
        roughness.front() += arriving;
        roughness.back() += arriving;
        spread(roughness);
        for (std::size_t i = 0; i < n; ++i) {
          allowed[at.first + i * at.stride] += roughness[i];
        }
      }
    }
    return largest_of_corners(std::move(allowed));
  }

  /// Of a cell's nodes.
  [[nodiscard]] Values largest_of_corners(Values values) const {
    for (int a = 0; a < grid_.dimensions(); ++a) {
      Values line(grid_.cells(a));
      for (const grids::Line& at : grids::lines_along(grid_, a)) {
        at.read(values.data(), line);
        for (std::size_t i = 0; i < line.size(); ++i) {
          values[at.first + i * at.stride] = std::max(line[i], line[(i + 1) % line.size()]);
        }
      }
    }
    return values;
  }

  /// What the derivatives of the other fields make of their jumps across the seam: J/Δx.
  [[nodiscard]] double jump_of_others(int axis, const grids::Line& at, Values& line) const {
    const MatrixXd coupling = solve::product(rows_.transpose(), system_.K(axis));
    const Eigen::VectorXd own = solve::product(rows_.transpose(), system_.constant_hessian().col(field_));
    double arriving = 0.0;
    for (int g = 0; g < system_.field_count(); ++g) {
      const auto& values = all_[static_cast<std::size_t>(g)];
      double factor = 0.0;
      for (Index r = 0; r < own.size(); ++r) {
        factor = own[r] != 0.0 ? std::max(factor, std::abs(coupling(r, g) / own[r])) : factor;
      }
      if (values && g != field_ && factor > 0.0) {
        at.read(values->data(), line);
        arriving += factor * seam_excess(line) / grid_.spacing(axis);
      }
    }
    return arriving;
  }

  /// Its error is that of a sum along the line, and its curvature anywhere counts; but it has to be periodic: of the
  /// seam, the change of slope alone.
  [[nodiscard]] double allowed_for_potential(bool whole) const {
    Values periodic(given_.begin(), given_.end());
    for (std::size_t i = 0; whole && i < periodic.size(); ++i) {
      periodic[i] -= ramp(i);
    }
    double allowed = rounding_of_data();
    for (int a = 0; a < grid_.dimensions(); ++a) {
      Values line(grid_.cells(a));
      double second = 0.0;
      for (const grids::Line& at : grids::lines_along(grid_, a)) {
        at.read(periodic.data(), line);
        const std::size_t n = line.size();
        second = std::max(second, std::abs((line[1] - line[0]) - (line[n - 1] - line[n - 2])));
        for (std::size_t i = 1; i + 1 < n; ++i) {
          second = std::max(second, second_difference(line, i));
        }
      }
      allowed += second_share * second;
    }
    return allowed;
  }

  void refuse_beyond(const Values& distance, const Values& allowed) const {
    std::size_t worst = 0;
    for (std::size_t i = 1; i < distance.size(); ++i) {
      if (std::abs(distance[i]) * allowed[worst] > std::abs(distance[worst]) * allowed[i]) {
        worst = i;
      }
    }
    if (std::abs(distance[worst]) <= allowed[worst]) {
      return;
    }
    std::vector<std::string> names;
    for (Index r = 0; r < rows_.rows(); ++r) {
      if (!rows_.row(r).isZero(0.0)) {
        names.push_back(system_.fields()[static_cast<std::size_t>(r)]);
      }
    }
    std::vector<std::string> place;
    for (int a = 0; a < grid_.dimensions(); ++a) {
      place.push_back(fmt::format("{} = {:.6g}", grid_.axis(a).name,
                                  grid_.axis(a).centre(grid_.place(worst)[static_cast<std::size_t>(a)])));
    }
    throw InitialFieldError(
        field_,
        fmt::format(
            "the initial {0} contradicts its constraint (the row of {1} in M z_t + K z_x = grad S): at {2} it "
            "differs by {3:.3g} from what the other fields determine, and truncation error accounts for {4:.2g} "
            "at most; leave {0} out, or correct it",
            system_.fields()[static_cast<std::size_t>(field_)], fmt::join(names, ", "), fmt::join(place, ", "),
            std::abs(distance[worst]), allowed[worst]));
  }

  const MultisymplecticSystem& system_;
  const grids::Grid& grid_;
  Collocation collocation_;
  int field_;
  const InitialFields& all_;
  const Values& given_;
  std::span<const double> computed_;
  const PotentialSlopes& slopes_;
  const MatrixXd& rows_;
};

}  // namespace

void check_agreement(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation, int field,
                     const InitialFields& given, const LatticeLevel& level, const MatrixXd& rows) {
  Comparison(system, grid, collocation, field, given, level, rows).refuse_contradiction();
}

}  // namespace rubato
