#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/pde/wave_rows.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// What the rests of the next step's stages are likely to be, from those G of the steps before: where the iteration for
/// them begins. On each wave one of three ways is taken, the one that came nearest to the last stage of the step
/// before. Of several stages, from up to three steps:
///
/// - the polynomial in time through the last step's stages, continued;
/// - a recurrence from step to step, G_i^{n+1} = α G_i^n + β G_i^{n-1}, whose α and β fit the stages of the last three
///   steps best, in least squares (Prony's method, wave by wave). It is exact where a wave turns with one or two
///   frequencies, however long the step: in what travels unchanged, in two of these while they are apart, in small
///   waves of either direction. Two steps show α alone;
/// - the same, and the polynomial through what it leaves of the last step, continued.
///
/// Of one stage the polynomials through the last step, the last four, the last eight, or as many as are known: steps of
/// second order are short beside what moves, and recurrences no better where they are not. What these come to for the
/// last step follows from those before it, and is not kept. Stages of several steps lie on no such polynomial, as each
/// is off by an error of its own.
///
/// What is foreseen is of a step as long as the last one, and from steps that are taken to be equally long. Where they
/// are not, each way is as far off as it is found to be.
class RestForecast {
public:
  /// Of so many fields.
  RestForecast(const GaussTableau& tableau, int fields, std::size_t waves);

  void forget();
  /// Of the last step; 0: none is known.
  [[nodiscard]] double last_h() const { return last_h_; }

  /// Rests of the stages of the step just taken, row f·m + i: to be filled, and then added.
  ///@{
  [[nodiscard]] WaveRows& next() { return past_[place(past_.size() - 1)]; }
  void add(double h);
  ///@}
  /// Rests of the stages of the next step, in the same rows. Hypothesis: last_h() is not 0.
  void foresee(WaveRows& rests);

  void save(StateWriter& state, const grids::Fourier& fourier) const;
  void restore(StateReader& state, const grids::Fourier& fourier);

private:
  /// Of foreseen_ and off_.
  [[nodiscard]] int row_of(std::size_t way, int field) const { return static_cast<int>(way) * fields_ + field; }
  /// Where the step so many before the last one is.
  [[nodiscard]] std::size_t place(std::size_t back) const { return (newest_ + back) % past_.size(); }

  /// The steps that are known.
  template <typename Past>
  void take_past(int field, std::size_t begin, Past& past) const;

  const GaussTableau tableau_;
  int m_, fields_;
  std::vector<double> onward_;   ///< ℓ_j(1 + c_i), by rows
  std::vector<double> at_last_;  ///< ℓ_j at the time for which the last stage was foreseen, in the step taken
  std::vector<WaveRows> past_;   ///< the last step's first
  /// Of several stages:
  ///@{
  WaveRows foreseen_;    ///< the last stage, row way·fields + f
  grids::FieldSet off_;  ///< and how far it was off the last time, in these rows
  WaveRows seen_;        ///< one row
  ///@}
  std::size_t newest_ = 0;
  int known_ = 0;
  double last_h_ = 0.0;
  bool reported_ = false;  ///< foreseen_ is of the next step
  bool judged_ = false;    ///< off_ is of recurrences, too
};

}  // namespace rubato
