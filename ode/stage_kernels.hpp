#pragma once

#include <cstddef>

/// What a sweep over the stages of collocation does beside evaluating ∇H: sums over stages. A row is a component of the
/// state, its stages side by side in row_length(stages) places, of which those past the last stage are 0 (in `from`:
/// are not read); rows follow one another. Every instruction set does the same roundings in the same order.
namespace rubato::stages {

/// Places of a row of so many stages (1 … 8): 2, 4 or 8.
[[nodiscard]] constexpr int row_length(int stages) {
  return stages <= 2 ? 2 : stages <= 4 ? 4 : 8;
}

/// to_r = factor (Σ_j from_rj first_j + Σ_j from_rj second_j) for each of `rows` rows; first_j and second_j are rows of
/// tables, one for each of `stages` stages. No second sum where `second` is null.
void combine(std::size_t rows, int stages, const double* from, const double* first, const double* second, double factor,
             double* to);
/// A correction of Y by fixed-point iteration: the same sums less Y into `correction`, and the sums into Y; to_r are
/// the stages high_r + (low_r + Y_r), of a state in two parts. \return relative_size() of it beside Y as it was
double correct(std::size_t rows, int stages, const double* from, const double* first, const double* second,
               double factor, const double* floor, const double* high, const double* low, double* Y, double* correction,
               double* to);
/// to_r = base_r + (rest_r + factor (Σ_j from_rj first_j + Σ_j from_rj second_j)): the same sums added to rows in two
/// parts.
void gather(std::size_t rows, int stages, const double* from, const double* first, const double* second, double factor,
            const double* base, const double* rest, double* to);
/// The same as correct() where Y_r becomes factor from_r.
double mend(std::size_t rows, int stages, const double* from, double factor, const double* floor, const double* high,
            const double* low, double* Y, double* correction, double* to);
/// to_r = high_r + (low_r + Y_r).
void place(std::size_t rows, int stages, const double* high, const double* low, const double* Y, double* to);
/// base_r = factor Σ_j from_rj first_j, and to_r = base_r + weight more_r.
void begin(std::size_t rows, int stages, const double* from, const double* first, double factor, const double* more,
           double weight, double* base, double* to);
/// The largest over the rows of |correction_r| / max(|Y_r|, |correction_r|, floor_r), in each the largest over its
/// places; NaN once a correction is.
[[nodiscard]] double relative_size(std::size_t rows, int stages, const double* Y, const double* correction,
                                   const double* floor);

}  // namespace rubato::stages
