#include <rubato/pde/wall_data.hpp>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/lines.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/static_condensation.hpp>

namespace rubato {

namespace {

using grids::End;

/// Parts of the largest value of a field, or of its largest difference of neighbours: more than this is no meeting, and
/// what is between is reported.
constexpr double not_met = 0.01, met_to_rounding = 1e-12, flat_slope = 0.01;

/// One wall of a box.
struct WallPlace {
  int axis = 0;
  bool is_right = false;

  [[nodiscard]] End end(const grids::Grid& grid) const {
    return is_right ? grid.axis(axis).right : grid.axis(axis).left;
  }
  [[nodiscard]] std::string name(const grids::Grid& grid) const {
    const grids::Axis& of = grid.axis(axis);
    return fmt::format("{} = {:.6g}", of.name, is_right ? of.to : of.from);
  }
  /// Calls use(node, step): a node of the wall, and the distance in memory to its neighbour inside.
  template <typename Use>
  void for_each_node(const grids::Grid& grid, const Use& use) const {
    const auto stride = static_cast<std::ptrdiff_t>(grid.stride(axis));
    const std::size_t last = (grid.cells(axis) - 1) * grid.stride(axis);
    for (const grids::Line& line : grids::lines_along(grid, axis)) {
      use(line.first + (is_right ? last : 0), is_right ? -stride : stride);
    }
  }
};

std::vector<WallPlace> walls_of(const grids::Grid& grid) {
  std::vector<WallPlace> walls;
  for (int a = 0; a < grid.dimensions(); ++a) {
    for (const bool is_right : {false, true}) {
      if (grid.axis(a).has_walls()) {
        walls.push_back({a, is_right});
      }
    }
  }
  return walls;
}

double largest_of_values(const std::vector<double>& values) {
  double largest = 0.0;
  for (const double value : values) {
    largest = std::max(largest, std::abs(value));
  }
  return largest;
}

class WallData {
public:
  WallData(const MultisymplecticSystem& system, const Mirrors& mirrors, InitialFields& given,
           std::shared_ptr<const WallDrives> drives)
      : system_(system), mirrors_(mirrors), grid_(mirrors.grid()), given_(given), drives_(std::move(drives)) {}

  std::vector<std::string> meet() {
    if (drives_ != nullptr) {
      meet_drives();
    }
    std::vector<std::vector<double>> held;
    for (const WallPlace& wall : walls_of(grid_)) {
      if (mirrors_.is_short()) {
        hold_rates(wall);
      } else {
        held.push_back(hold(wall));
        if (wall.is_right) {
          compare(wall, held[held.size() - 2], held.back());
        }
      }
      look_at_slopes(wall);
      look_at_pairs(wall);
    }
    return std::move(cautions_);
  }

private:
  [[nodiscard]] const std::string& name(std::size_t field) const { return system_.fields()[field]; }
  [[nodiscard]] std::string_view kind(const WallPlace& wall) const {
    return wall.end(grid_) == End::fixed ? "fixed" : "free";
  }
  [[nodiscard]] int sign(const WallPlace& wall, std::size_t field) const {
    return mirrors_.sign(wall.axis, static_cast<int>(field), wall.end(grid_));
  }

  [[nodiscard]] bool is_driven(const WallPlace& wall, int field) const {
    return drives_ != nullptr && std::ranges::any_of(drives_->walls, [&](const WallDrive& drive) {
             const auto row = momentum_row(system_, drive.field);
             return drive.axis == wall.axis && drive.is_right == wall.is_right && row && row->v == field;
           });
  }
  void meet_drives() {
    DrivenNodes driven(drives_, system_, grid_);
    std::vector<double> largest, miss(given_.size(), 0.0);
    for (const auto& values : given_) {
      largest.push_back(values ? largest_of_values(*values) : 0.0);
    }
    for (const DrivenNodes::Node& node : driven.nodes()) {
      const DrivenNodes::Values values = driven.at(node, drives_->start);
      const auto meet = [&](int field, double value) {
        const auto f = static_cast<std::size_t>(field);
        if (given_[f]) {
          double& here = (*given_[f])[node.node];
          miss[f] = std::max(miss[f], std::abs(here - value));
          largest[f] = std::max(largest[f], std::abs(value));
          here = value;
        }
      };
      meet(node.u, values.u);
      meet(node.row.v, values.v);
    }
    for (std::size_t f = 0; f < miss.size(); ++f) {
      const bool is_momentum = momentum_row(system_, static_cast<int>(f)) == std::nullopt;
      if (!is_momentum && !(miss[f] <= not_met * largest[f])) {
        throw InitialFieldError(static_cast<int>(f),
                                fmt::format("{} differs by {:.6g} from what a wall of [grid] gives it at the start: "
                                            "give initial data that meet the wall, or another formula there",
                                            name(f), miss[f]));
      }
      if (miss[f] > met_to_rounding * largest[f]) {
        cautions_.push_back(
            fmt::format("{} misses by {:.2g} what a wall of [grid] gives it at the start, and is set to that there: "
                        "what is left of the difference runs into the domain as short waves",
                        name(f), miss[f]));
      }
    }
  }

  /// Where a wall holds fields at whatever values they begin with: momenta, which say that these do not change.
  void hold_rates(const WallPlace& wall) {
    for (std::size_t f = 0; f < given_.size(); ++f) {
      const auto row = static_cast<int>(f);
      if (is_driven(wall, row)) {
        continue;
      }
      if (given_[f] && sign(wall, f) < 0 && in_no_K(system_, row) && !system_.M().row(row).isZero(0.0)) {
        if (const auto linear = linear_row(system_, row)) {
          hold(wall, f, 0.0 - linear->b / linear->a);
        }
      }
    }
  }

  /// The values that a wall holds fields at, 0 for others.
  std::vector<double> hold(const WallPlace& wall) {
    std::vector<int> signs;
    for (std::size_t f = 0; f < given_.size(); ++f) {
      signs.push_back(sign(wall, f));
    }
    std::vector<double> centre(given_.size(), 0.0);
    if (const auto changed = find_changed_term(system_, signs, centre)) {
      // No odd field is 0 in the middle of a mirror: perhaps one is its value at the wall.
      for (std::size_t f = 0; f < given_.size(); ++f) {
        centre[f] = signs[f] < 0 && given_[f] ? value_at(wall, f) : 0.0;
      }
      if (find_changed_term(system_, signs, centre)) {
        refuse(wall, *changed);
      }
    }
    for (std::size_t f = 0; f < given_.size(); ++f) {
      if (signs[f] < 0 && given_[f]) {
        centre[f] = hold(wall, f, signs, centre);
      }
    }
    return centre;
  }

  /// The value that a wall holds one field at.
  double hold(const WallPlace& wall, std::size_t f, const std::vector<int>& signs, std::vector<double> centre) {
    const double largest = largest_of_values(*given_[f]), here = value_at(wall, f);
    centre[f] = std::abs(here) <= met_to_rounding * largest ? 0.0 : here;
    if (find_changed_term(system_, signs, centre)) {
      centre[f] = 0.0;
    }
    hold(wall, f, centre[f]);
    return centre[f];
  }

  /// Lets a field be `held` at a wall.
  void hold(const WallPlace& wall, std::size_t f, double held) {
    std::vector<double>& values = *given_[f];
    const double largest = largest_of_values(values);
    double miss = 0.0;
    wall.for_each_node(grid_, [&](std::size_t node, std::ptrdiff_t) {
      miss = std::max(miss, std::abs(values[node] - held));
      values[node] = held;
    });
    if (!(miss <= not_met * largest)) {
      throw InitialFieldError(
          static_cast<int>(f),
          fmt::format("{0} differs by up to {1:.6g} from {2:.6g}, the one value at which the {3} wall at {4} holds it: "
                      "give initial data that meet the wall, or another wall",
                      name(f), miss, held, kind(wall), wall.name(grid_)));
    }
    if (miss > met_to_rounding * largest) {
      cautions_.push_back(
          fmt::format("{0} misses by {1:.2g} the value {2:.6g} at which the wall at {3} holds it, and is set to that "
                      "there: what is left of the difference runs into the domain as short waves",
                      name(f), miss, held, wall.name(grid_)));
    }
  }

  [[nodiscard]] double value_at(const WallPlace& wall, std::size_t f) const {
    double value = 0.0;
    wall.for_each_node(grid_, [&](std::size_t node, std::ptrdiff_t) {
      value = std::abs((*given_[f])[node]) > std::abs(value) ? (*given_[f])[node] : value;
    });
    return value;
  }

  [[noreturn]] void refuse(const WallPlace& wall, const formula::ChangedTerm& changed) const {
    throw SchemeRefusal(
        fmt::format("the {0} wall at {1} needs an S that is the same in the mirror there, and its term {2} changes "
                    "(from {3:.6g} to "
                    "{4:.6g} at some z). Take the other kind of wall, or leave left and right out",
                    kind(wall), wall.name(grid_), changed.term, changed.before, changed.after));
  }

  /// Of two walls that hold a field.
  void compare(const WallPlace& right, const std::vector<double>& at_left, const std::vector<double>& at_right) const {
    const WallPlace left{right.axis, false};
    for (std::size_t f = 0; f < given_.size(); ++f) {
      const double size = std::max(std::abs(at_left[f]), std::abs(at_right[f]));
      if (sign(left, f) < 0 && sign(right, f) < 0 && std::abs(at_left[f] - at_right[f]) > met_to_rounding * size) {
        throw InitialFieldError(static_cast<int>(f),
                                fmt::format("{0} is {1:.6g} at the wall at {2} and {3:.6g} at that at {4}: walls that "
                                            "both hold a field have to hold it at one value",
                                            name(f), at_left[f], left.name(grid_), at_right[f], right.name(grid_)));
      }
    }
  }

  /// Of fields of second order in time, which all walls of one kind hold, or leave free, but where an equation joins
  /// one with the slope of another.
  void look_at_pairs(const WallPlace& wall) {
    std::vector<std::string> held, loose;
    for (std::size_t f = 0; f < given_.size(); ++f) {
      const auto field = static_cast<int>(f);
      const bool turns = mirrors_.sign(wall.axis, field, End::fixed) != mirrors_.sign(wall.axis, field, End::free);
      if (turns && momentum_row(system_, field)) {
        (sign(wall, f) < 0 ? held : loose).push_back(name(f));
      }
    }
    if (!held.empty() && !loose.empty()) {
      cautions_.push_back(fmt::format(
          "the {} wall at {} holds {} and leaves {} free: an equation joins the one with the slope of the other, so "
          "that their signs in a mirror are opposite, and the field that is stated first has the kind of the wall; no "
          "scheme has walls that hold both",
          kind(wall), wall.name(grid_), fmt::join(held, ", "), fmt::join(loose, ", ")));
    }
  }

  /// Of fields that a wall leaves free.
  void look_at_slopes(const WallPlace& wall) {
    for (std::size_t f = 0; f < given_.size(); ++f) {
      if (!given_[f] || sign(wall, f) < 0 || system_.structure().algebraic[f]) {
        continue;
      }
      const std::vector<double>& u = *given_[f];
      double most = 0.0, slope = 0.0;
      for (const grids::Line& line : grids::lines_along(grid_, wall.axis)) {
        for (std::size_t i = 1; i < grid_.cells(wall.axis); ++i) {
          const double* const at = u.data() + line.first + i * line.stride;
          most = std::max(most, std::abs(*at - *(at - line.stride)));
        }
      }
      wall.for_each_node(grid_, [&](std::size_t node, std::ptrdiff_t step) {
        const double* const at = u.data() + node;
        // Of third order and of second order: where these differ by more than they are, they show the truncation error.
        const double third = (-11.0 * at[0] + 18.0 * at[step] - 9.0 * at[2 * step] + 2.0 * at[3 * step]) / 6.0;
        const double second = (-3.0 * at[0] + 4.0 * at[step] - at[2 * step]) / 2.0;
        slope = std::abs(third) > std::abs(third - second) ? std::max(slope, std::abs(third)) : slope;
      });
      if (slope > std::max(flat_slope * most, met_to_rounding * largest_of_values(u))) {
        cautions_.push_back(fmt::format(
            "the slope of {0} is {1:.2g} at the wall at {2}, which asks for 0: the kink runs into the domain as short "
            "waves; give initial data that meet the wall",
            name(f), slope / grid_.spacing(wall.axis), wall.name(grid_)));
      }
    }
  }

  const MultisymplecticSystem& system_;
  const Mirrors& mirrors_;
  const grids::Grid& grid_;
  InitialFields& given_;
  std::shared_ptr<const WallDrives> drives_;
  std::vector<std::string> cautions_;
};

}  // namespace

std::vector<std::string> meet_walls(const MultisymplecticSystem& system, const Mirrors& mirrors, InitialFields& given,
                                    std::shared_ptr<const WallDrives> drives) {
  return WallData(system, mirrors, given, std::move(drives)).meet();
}

}  // namespace rubato
