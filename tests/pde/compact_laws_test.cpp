// The laws of schemes on cells and at corners by formulas of a node: on any states those that are computed in passes.

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include <catch2/catch.hpp>

#include <rubato/pde/law_evaluator.hpp>

#include "mesh_cases.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::FieldSet;

namespace {

/// The middle of a step as its only stage: laws over the stages of it are those at the middle.
class Middle final : public StageSource {
public:
  Middle(const MultisymplecticSystem& system, std::size_t nodes)
      : system_(system), z_(system.field_count(), nodes), rate_(z_) {}

  Status take(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    for (int f = 0; f < z_.fields(); ++f) {
      const bool in_slab = system_.structure().at_midpoints(f);
      for (std::size_t i = 0; i < z_.size(); ++i) {
        const double low = before.fields.field(f)[i], high = after.fields.field(f)[i];
        z_.field(f)[i] = in_slab ? high : 0.5 * (low + high);
        rate_.field(f)[i] = in_slab ? 0.0 : (high - low) / h;
      }
    }
    return Status::success;
  }
  [[nodiscard]] int count() const override { return 1; }
  [[nodiscard]] double weight(int /*stage*/) const override { return 1.0; }
  void stage(int /*stage*/, FieldSet& z, FieldSet& rate) override {
    z = z_;
    rate = rate_;
  }

private:
  const MultisymplecticSystem& system_;
  FieldSet z_, rate_;
};

double largest_difference(const FieldSet& a, const FieldSet& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.all().size(); ++i) {
    largest = std::max(largest, std::abs(a.all()[i] - b.all()[i]));
  }
  return largest;
}

}  // namespace

TEST_CASE("laws by formulas of a node are those in passes, on any states") {
  const double h = 0.2;
  int taken = 0;
  for (const auto& [system, grid] : mesh_cases()) {
    const int d = system.field_count();
    const std::size_t nodes = grid.size();
    std::vector<LinearSymmetry> symmetries;
    if (d == 4 && grid.dimensions() == 1 && system.fields().front() == "p") {
      Eigen::MatrixXd B = Eigen::MatrixXd::Zero(4, 4);  // the phase of Schroedinger's equation
      B(0, 1) = B(2, 3) = -1.0;
      B(1, 0) = B(3, 2) = 1.0;
      symmetries.push_back({"charge", B});
    }
    PotentialSlopes slopes;
    slopes.of_field.resize(static_cast<std::size_t>(d));
    for (std::size_t line = 0; line < nodes / grid.cells(0); ++line) {
      slopes.of_field.back().push_back(0.3 - 0.1 * static_cast<double>(line));
    }
    const LatticeLevel before{random_fields(d, nodes, 1), slopes}, after{random_fields(d, nodes, 2), slopes};
    const LawTables tables(system, grid, symmetries);
    const auto count = static_cast<int>(tables.names.size());
    for (const bool on_cells : {true, false}) {
      const auto make = [&](std::shared_ptr<StageSource> stages) {
        return on_cells ? make_edge_laws(tables, Collocation::cells, std::move(stages))
                        : make_node_laws(tables, Collocation::corners, std::move(stages));
      };
      INFO((on_cells ? "cells" : "corners")
           << ", " << d << " fields from " << system.fields().front() << ", " << grid.dimensions() << " dimensions");
      const auto compact = make(nullptr), passes = make(std::make_shared<Middle>(system, nodes));
      FieldSet found(count, nodes), expected(found), other(found);
      const std::vector<Spread> sizes = compact->residuals(before, after, h, found.pointers());
      static_cast<void>(passes->residuals(before, after, h, expected.pointers()));
      static_cast<void>(compact->residuals(before, after, 1.001 * h, other.pointers()));
      // Sums of some dozen terms of order 1 over h and Δx, 5 and 3.5, to units in the last place.
      CHECK(largest_difference(found, expected) < 2e-13);
      CHECK(largest_difference(other, expected) > 1e-3);  // the twin
      for (int law = 0; law < count; ++law) {
        const auto values = found.field(law);
        CHECK(sizes[static_cast<std::size_t>(law)].largest() ==
              std::abs(*std::ranges::max_element(values, {}, [](double x) { return std::abs(x); })));
      }
      // Sizes alone, and totals.
      CHECK(compact->residuals(before, after, h, {}).front().largest() == sizes.front().largest());
      const std::vector<double> totals = compact->totals(after), expected_totals = passes->totals(after);
      for (std::size_t law = 0; law < totals.size(); ++law) {
        CHECK(totals[law] == Approx(expected_totals[law]).margin(1e-12));
      }
      CHECK(compact->totals(before) != totals);
      // Of the level that the last step led to, by that step or, where another level was asked for since, anew.
      CHECK(compact->totals_after(after) == totals);
      static_cast<void>(compact->residuals(before, after, h, {}));
      CHECK(compact->totals_after(after) == totals);
      static_cast<void>(compact->residuals(after, before, h, {}));
      CHECK(compact->totals_after(before) == compact->totals(before));
      // Where stages are shared the laws are taken over these, and at the middle again without.
      compact->share(std::make_shared<Middle>(system, nodes));
      static_cast<void>(compact->residuals(before, after, h, other.pointers()));
      CHECK(std::ranges::equal(other.all(), expected.all()));
      compact->share(nullptr);
      static_cast<void>(compact->residuals(before, after, h, other.pointers()));
      CHECK(std::ranges::equal(other.all(), found.all()));
      ++taken;
    }
  }
  CHECK(taken >= 18);
}
