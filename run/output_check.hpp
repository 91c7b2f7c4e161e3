#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/problem/stored.hpp>
#include <rubato/run/findings.hpp>
#include <rubato/run/output.hpp>
#include <rubato/run/output_times.hpp>

namespace rubato {

/// What a record tells under /output, made anew from the levels around each time, as far as these are stored.
class OutputCheck {
public:
  /// \param components how many numbers of a state have one scale: a field's, or one
  OutputCheck(const record::Reader& reader, const StoredLevels& levels, const Problem& problem, std::size_t components,
              Findings& findings);

  /// The times themselves.
  void check_times();
  /// What is told at a stored level, and in the step that leads there from the level before.
  ///@{
  void check_level(std::size_t level, std::span<const double> z);
  void check_step(std::size_t level, std::span<const double> before, std::span<const double> z);
  ///@}

private:
  struct Place {
    std::size_t level;  ///< at it, or in the step that leads to it
    double t;
  };

  void find_places();
  template <typename Make>
  void compare(std::size_t row, Make&& make);
  [[nodiscard]] std::vector<double> displaced(std::span<const double> z, int attempt, int level);
  void see(std::span<const double> z);

  const record::Reader& reader_;
  const StoredLevels& levels_;
  const Problem& problem_;
  std::size_t components_;
  Findings& findings_;
  std::unique_ptr<OutputMaker> maker_;
  std::vector<Place> places_;
  std::vector<StoredRows> columns_;
  std::vector<double> scales_;  ///< largest magnitude of each component so far
};

}  // namespace rubato
