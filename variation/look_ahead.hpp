#pragma once

#include <limits>

#include <rubato/variation/level_scheme.hpp>
#include <rubato/variation/step_potential.hpp>

namespace rubato {

/// A look-ahead for the choice of a step potential (theory, section 9): steps of the scheme from where it stands, as
/// many as can be taken, and what is seen of η in the middle of each; the scheme goes back. Steps are |first_step|·2^k
/// long: as long as η hardly changes from one to the next and longer steps show the same η, so that a stretch where
/// nothing happens costs little, on an eccentric orbit as on a large lattice.
///
/// It sees some hundred first steps, the time in which an orbit does what it does, if they resolve it; and goes on
/// where |η| is largest near the end, as when two waves are about to meet, or where the second half of what was seen
/// has nothing like the largest, as on an eccentric orbit that has left its pericentre. At order 4 and more it ends
/// much sooner where the orbit repeats itself and equal steps do as well as any (equal_steps.hpp), or where K shows
/// nothing of steps, and longer ones cost as much or cannot be taken. How long the run is to be is nothing to it, since
/// a run may be continued, but where K does not depend on h: then it looks to the end. \param one_step the first step
/// is all that is wanted, if K depends on h there \param tolerance that levels will be solved to \param run_length
/// |until - start|; infinite if that is not known \param farthest how far it looks at most
/// \throws Interrupted (base/interrupt.hpp), with the scheme where it stood
[[nodiscard]] LookAhead look_ahead(LevelScheme& scheme, double first_step, bool one_step, double tolerance,
                                   double run_length = std::numeric_limits<double>::infinity(),
                                   double farthest = std::numeric_limits<double>::infinity());

}  // namespace rubato
