#pragma once

/// \file
/// The comparisons, one for each equation.

namespace comparison {

void sine_gordon(int repeats);
void klein_gordon(int repeats);
void schroedinger(int repeats);
void korteweg_de_vries(int repeats);
void two_solitons(int repeats);
void benjamin_bona_mahony(int repeats);

/// Solitons in the laboratory and in the frame that moves with them, by peers, too.
void frames(int repeats);

/// The price of a level of second order, whatever its error.
void second_order(int repeats);

}  // namespace comparison
