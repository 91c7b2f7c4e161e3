#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// A value that a wall gives a field in time, in place of holding what it begins with.
struct WallDrive {
  int axis = 0;
  bool is_right = false;
  int field = 0;
  formula::Bytecode code;  ///< g and ∂g/∂t, of t and the coordinates of the grid
};
struct WallDrives {
  std::vector<WallDrive> walls;
  double start = 0.0;  ///< t_0
};

/// A field u with its momentum v: the row of v is m u_t = a v + b.
struct MomentumRow {
  int v = 0;
  double m = 0.0, a = 0.0, b = 0.0;

  [[nodiscard]] double rate(double momentum) const { return (a * momentum + b) / m; }
  [[nodiscard]] double momentum(double rate) const { return (m * rate - b) / a; }
};
/// Nothing where M couples u with another field than such a v.
[[nodiscard]] std::optional<MomentumRow> momentum_row(const MultisymplecticSystem& system, int u);

/// The nodes on walls that give values.
class DrivenNodes {
public:
  /// \param grid between walls, or with ghosts of them
  /// \throws SchemeRefusal if a field has no momentum, or walls do not hold it
  DrivenNodes(std::shared_ptr<const WallDrives> drives, const MultisymplecticSystem& system, const grids::Grid& grid);

  struct Node {
    std::size_t drive = 0;  ///< of WallDrives
    std::size_t node = 0;
    double weight = 1.0;  ///< one half for each wall that it is on
    int u = 0;
    MomentumRow row;
  };
  [[nodiscard]] const std::vector<Node>& nodes() const { return nodes_; }
  /// The fields u, and their momenta.
  [[nodiscard]] const std::vector<int>& fields() const { return fields_; }
  [[nodiscard]] double start() const { return drives_->start; }

  struct Values {
    double u = 0.0, v = 0.0;
  };
  [[nodiscard]] Values at(const Node& node, double t);

private:
  std::shared_ptr<const WallDrives> drives_;
  grids::Grid grid_;
  std::vector<formula::ScalarEvaluator> evaluate_;
  std::vector<Node> nodes_;
  std::vector<int> fields_;
};

}  // namespace rubato
