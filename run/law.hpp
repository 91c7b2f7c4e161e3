#pragma once

#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <rubato/base/spread.hpp>
#include <rubato/figures/statistics.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// A local law along a run: its residual over the step taken last, evaluated from the two levels of the step, per cell
/// or per node. A run, the check of its record and a replay hold the same objects; each has columns of its own in the
/// record, and writes them itself.
class Law {
public:
  /// \param cells where the residual in every cell is to be found; empty if its sizes alone are reported
  explicit Law(std::string name, std::span<const double> cells = {}) : name_(std::move(name)), cells_(cells) {}

  [[nodiscard]] const std::string& name() const { return name_; }
  /// The magnitudes over the step taken last; with count 0 where it has none.
  [[nodiscard]] const Spread& size() const { return size_; }
  [[nodiscard]] const figures::ResidualFigures& figures() const { return figures_; }
  /// The residual in every cell, or at every node; not a number where it was not taken.
  [[nodiscard]] std::span<const double> cells() const { return cells_; }
  [[nodiscard]] bool has_cells() const { return !cells_.empty(); }
  void set(const Spread& size) {
    size_ = size;
    figures_ = figures::ResidualFigures::of(size);
  }

  /// Where a record has it.
  ///@{
  [[nodiscard]] std::string max_path() const { return "/laws/" + name_ + "_max"; }
  [[nodiscard]] std::string rms_path() const { return "/laws/" + name_ + "_rms"; }
  [[nodiscard]] std::string undefined_path() const { return "/laws/" + name_ + "_undefined"; }
  [[nodiscard]] std::string cells_path() const { return "/laws/fields/" + name_; }
  ///@}

  /// Adds its columns: of every step; and of the cells, at the stored levels.
  /// \param gaps whether there are levels at which laws are not taken
  ///@{
  void describe(record::Layout& layout, bool gaps);
  void describe_cells(record::Layout& layout, const std::vector<std::string>& dimensions, bool gaps);
  ///@}
  /// Appends a row to them.
  ///@{
  void append(RowSink& sink) const;
  void append_cells(RowSink& sink) const { sink.append(cells_column_, cells_); }
  ///@}

private:
  std::string name_;
  std::span<const double> cells_;
  Spread size_;
  figures::ResidualFigures figures_ = figures::ResidualFigures::of({});
  record::Column max_, rms_, undefined_, cells_column_;
};

}  // namespace rubato
