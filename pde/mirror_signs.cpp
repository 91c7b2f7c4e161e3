#include <rubato/pde/mirror_signs.hpp>

#include <utility>

#include <fmt/format.h>

#include <rubato/pde/lattice_scheme.hpp>

namespace rubato {

namespace {

/// Whether f is the derivative, by the row of another field, of a field after it that S does not name: u of u = φ_x.
/// What its own row gives is the slope of that field.
bool has_later_potential(const MultisymplecticSystem& system, int axis, std::size_t f) {
  const auto d = static_cast<std::size_t>(system.field_count());
  for (std::size_t potential = f + 1; potential < d; ++potential) {
    for (std::size_t multiplier = 0; multiplier < d && system.structure().potential[potential]; ++multiplier) {
      const auto row = static_cast<Eigen::Index>(multiplier);
      if (multiplier != f && system.K(axis)(row, static_cast<Eigen::Index>(potential)) != 0.0 &&
          system.M().row(row).isZero(0.0) && system.constant_hessian()(row, static_cast<Eigen::Index>(f)) != 0.0) {
        return true;
      }
    }
  }
  return false;
}

/// Joins a field that M and K couple with none of these, and that S multiplies by one: c z_f z_g is the same in a
/// mirror where both have one sign. \return false if there is none
bool join_next(const MultisymplecticSystem& system, std::vector<std::size_t>& joined, std::vector<int>& signs) {
  for (const std::size_t f : joined) {
    for (std::size_t g = 0; g < signs.size(); ++g) {
      if (signs[g] == 0 &&
          system.constant_hessian()(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(g)) != 0.0) {
        signs[g] = signs[f];
        joined.push_back(g);
        return true;
      }
    }
  }
  return false;
}

}  // namespace

MirrorSigns::MirrorSigns(const MultisymplecticSystem& system, int axis, const std::string& name) {
  const auto d = static_cast<std::size_t>(system.field_count());
  of_field.assign(d, 0);
  couples.assign(d, false);
  // The sign that one field gives another; 0 where they are not coupled.
  const auto relation = [&](std::size_t f, std::size_t g) {
    const auto row = static_cast<Eigen::Index>(f), column = static_cast<Eigen::Index>(g);
    int sign = system.M()(row, column) != 0.0 ? 1 : 0;
    bool clash = false;
    for (int a = 0; a < system.directions(); ++a) {
      if (system.K(a)(row, column) != 0.0) {
        const int here = a == axis ? -1 : 1;
        clash = clash || (sign != 0 && sign != here);
        sign = here;
      }
    }
    return std::pair(sign, clash);
  };
  const auto moves = [&](std::size_t f) { return !system.M().row(static_cast<Eigen::Index>(f)).isZero(0.0); };
  std::vector<std::size_t> order;
  for (const bool leads : {true, false}) {
    for (std::size_t f = 0; f < d; ++f) {
      if ((moves(f) || has_later_potential(system, axis, f)) == leads) {
        order.push_back(f);
      }
    }
  }
  for (const std::size_t lead : order) {
    if (of_field[lead] != 0) {
      continue;
    }
    of_field[lead] = 1;
    std::vector<std::size_t> joined = {lead};
    bool any = false;
    for (std::size_t i = 0; i < joined.size() || join_next(system, joined, of_field); ++i) {
      const std::size_t f = joined[i];
      for (std::size_t g = 0; g < d; ++g) {
        const auto [sign, clash] = relation(f, g);
        if (sign == 0) {
          continue;
        }
        any = any || system.K(axis)(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(g)) != 0.0;
        if (of_field[g] == 0) {
          of_field[g] = sign * of_field[f];
          joined.push_back(g);
        }
        if (clash || of_field[g] != sign * of_field[f]) {
          throw SchemeRefusal(
              fmt::format("walls along {0} need an equation that is the same in a mirror, and M and K couple {1} with "
                          "{2} so that no "
                          "signs of the fields make it so: leave left and right out",
                          name, system.fields()[f], system.fields()[g]));
        }
      }
    }
    for (const std::size_t f : joined) {
      couples[f] = any;
    }
  }
}

std::vector<std::pair<int, std::size_t>> FieldMirrors::held(const grids::Grid& grid) const {
  std::vector<std::pair<int, std::size_t>> held;
  for (std::size_t node = 0; node < grid.size(); ++node) {
    const auto place = grid.place(node);
    for (int a = 0; a < grid.dimensions(); ++a) {
      const grids::Axis& axis = grid.axis(a);
      const std::size_t at = place[static_cast<std::size_t>(a)];
      const int fields = axis.is_on_wall(at) ? static_cast<int>(offsets_[static_cast<std::size_t>(a)].size()) : 0;
      for (int f = 0; f < fields; ++f) {
        if (offset(a, f) == 0 && sign(a, f, axis.is_on_wall(at, false) ? axis.left : axis.right) < 0) {
          held.emplace_back(f, node);
        }
      }
    }
  }
  return held;
}

std::vector<PlaceNumbers> FieldMirrors::loose(const grids::Grid& grid, int field) const {
  std::vector<PlaceNumbers> all;
  for (int a = 0; a < grid.dimensions(); ++a) {
    const grids::Axis& axis = grid.axis(a);
    PlaceNumbers numbers{a, std::vector<double>(axis.cells, 1.0)};
    const std::vector<double> free = numbers.values;
    for (const bool is_right : {false, true}) {
      if (axis.ghosts > 0 && offset(a, field) == 0 && sign(a, field, is_right ? axis.right : axis.left) < 0) {
        for (std::size_t i = 0; i < axis.cells; ++i) {
          numbers.values[i] = axis.is_on_wall(i, is_right) ? 0.0 : numbers.values[i];
        }
      }
    }
    if (numbers.values != free) {
      all.push_back(std::move(numbers));
    }
  }
  return all;
}

FieldMirrors::FieldMirrors(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation) {
  const FieldStructure& structure = system.structure();
  for (int a = 0; a < grid.dimensions(); ++a) {
    const grids::Axis& axis = grid.axis(a);
    std::vector<int>& offsets = offsets_.emplace_back(static_cast<std::size_t>(system.field_count()), 0);
    signs_.emplace_back();
    if (axis.left == grids::End::periodic) {
      continue;
    }
    signs_.back().emplace(system, a, axis.name);
    const Eigen::MatrixXd& plus = structure.K_plus[static_cast<std::size_t>(a)];
    for (int f = 0; collocation == Collocation::corners && f < system.field_count(); ++f) {
      if (structure.algebraic[static_cast<std::size_t>(f)]) {
        offsets[static_cast<std::size_t>(f)] = !plus.row(f).isZero(0.0) ? 1 : !plus.col(f).isZero(0.0) ? -1 : 0;
      }
    }
  }
}

}  // namespace rubato
