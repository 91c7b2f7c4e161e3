#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/problem/stored.hpp>
#include <rubato/run/disagreements.hpp>
#include <rubato/run/output.hpp>
#include <rubato/run/output_times.hpp>
#include <rubato/run/shared_rows.hpp>
#include <rubato/run/state_scales.hpp>

namespace rubato {

/// What a record shows under /output, made anew from the levels around each time, as far as these are stored.
class OutputCheck {
public:
  /// \param components how many numbers of a state have one scale: a field's, or one
  OutputCheck(const SharedRecord& record, const StoredLevels& levels, const Problem& problem, std::size_t components,
              Disagreements& findings);

  /// The times themselves.
  void check_times();
  /// What is reported at a stored level, and in the step that leads there from the level before.
  /// \param state_row of the level among the stored states
  ///@{
  void check_level(std::size_t state_row, std::span<const double> z);
  void check_step(std::size_t state_row, std::span<const double> before, std::span<const double> z);
  ///@}

private:
  /// A row of the output.
  struct Place {
    std::size_t level;  ///< at it, or in the step that leads to it
    double t;
    std::size_t row;
  };

  /// \return whether there have to be so many rows
  ///@{
  [[nodiscard]] bool find_places(std::size_t rows);
  [[nodiscard]] bool find_levels(std::size_t rows);
  [[nodiscard]] bool find_times(std::size_t rows);
  ///@}
  template <typename Make>
  void compare(std::size_t row, Make&& make);

  SharedRecord record_;
  const StoredLevels& levels_;
  const Problem& problem_;
  Disagreements& findings_;
  PartDisagreements parts_;
  std::unique_ptr<OutputMaker> maker_;
  std::vector<Place> places_;  ///< those of which the record shows the level, in order
  std::vector<SharedRows> columns_;
  StateScales scales_;
};

}  // namespace rubato
