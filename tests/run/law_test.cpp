// A law writes its own columns of a record, by the handles that it got, whatever else is in the layout and in whatever
// order rows are appended.

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/run/law.hpp>

using namespace rubato;

namespace {

class Rows final : public RowSink {
public:
  using RowSink::append;
  explicit Rows(const rubato::record::Layout& layout) : layout_(layout) {}
  void append(rubato::record::Column column, std::span<const double> row) override { keep(column, row); }
  void append(rubato::record::Column column, std::span<const std::int64_t> row) override { keep(column, row); }
  [[nodiscard]] const std::vector<double>& at(const std::string& path) const { return rows_.at(path); }
  [[nodiscard]] std::size_t count() const { return rows_.size(); }

private:
  template <typename Row>
  void keep(rubato::record::Column column, Row row) {
    rows_[layout_.datasets.at(column.number).path].assign(row.begin(), row.end());
  }

  const rubato::record::Layout& layout_;
  std::map<std::string, std::vector<double>> rows_;
};

}  // namespace

TEST_CASE("a law writes its own columns by their handles") {
  const std::vector<double> cells = {1.0, -3.0, 2.0};
  rubato::Spread first, second;
  for (const double value : cells) {
    first.add(value);
  }
  second.add(0.5);
  std::vector<Law> laws = {Law("energy", cells), Law("multisymplectic")};
  rubato::record::Layout layout;
  const rubato::record::Column other = layout.add({"/levels/h", "/levels/step"});
  for (Law& law : laws) {
    law.describe(layout, false);
    static_cast<void>(layout.add({"/between/" + law.name(), "/levels/step"}));
  }
  laws[0].describe_cells(layout, {"/grid/x_cell"}, false);
  laws[0].set(first);
  laws[1].set(second);
  CHECK(laws[0].has_cells());
  CHECK_FALSE(laws[1].has_cells());

  Rows rows(layout);
  laws[0].append_cells(rows);
  laws[1].append(rows);
  rows.append(other, 7.0);
  laws[0].append(rows);
  CHECK(rows.count() == 8);
  CHECK(rows.at("/levels/h").front() == 7.0);
  CHECK(rows.at("/laws/energy_max").front() == 3.0);
  CHECK(rows.at("/laws/energy_rms").front() == Approx(std::sqrt(14.0 / 3.0)));
  CHECK(rows.at("/laws/energy_undefined").front() == 0.0);
  CHECK(rows.at("/laws/fields/energy") == cells);
  CHECK(rows.at("/laws/multisymplectic_max").front() == 0.5);
  CHECK(rows.at("/laws/multisymplectic_max") != rows.at("/laws/energy_max"));  // the twin

  laws[1].set({});
  laws[1].append(rows);
  CHECK(std::isnan(rows.at("/laws/multisymplectic_max").front()));  // of a step that has none
}
