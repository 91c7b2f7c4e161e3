#include <rubato/problem/keys.hpp>

#include <algorithm>
#include <functional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/ode/orbit_methods.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/problem/solve.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

namespace {

constexpr std::array<TableEntry, 41> all_tables{{
    {"", "one of [hamiltonian], [lagrangian], [multisymplectic] and [field] says what is to be solved"},
    {"hamiltonian", "an orbit: q' = dH/dp, p' = -dH/dq"},
    {"lagrangian",
     "an orbit, too: d/dt dL/dq_dot = dL/dq; the velocity of q is called q_dot, and its momentum, dL/dq_dot, p_q"},
    {"multisymplectic", "a lattice: M z_t + K.x z_x (+ K.y z_y + K.z z_z) = grad S(z)"},
    {"multisymplectic.K", "the matrices of the space derivatives, one for each direction of the grid"},
    {"field",
     "a lattice, too, by the density of its Lagrangian or Hamiltonian: M, K and S are derived. A derivative is a "
     "field's "
     "name with the directions behind it, u_t, u_xx; one that becomes a field has that name in [initial], too"},
    {"grid", "the grid of a lattice: each direction is periodic, or between two walls"},
    {"grid.x",
     "one direction, and so grid.y, grid.z: nodes from + i*(to - from)/cells, i = 0 ... cells-1, and between walls "
     "cells, too"},
    {"grid.x.jump",
     "jump = { u = \"2*pi\" }: by how much a field is larger at the end of the period than at its beginning, so that "
     "one "
     "kink can go round; S has to be the same there",
     "a field"},
    {"grid.x.phase",
     "phase = { psi = \"k*L\" }: the angle by which a complex unknown of [field], or what an entry of [symmetries] "
     "turns, "
     "has turned at the end of the period, psi(x + L) = exp(i k L) psi(x), as Bloch waves have",
     "a complex unknown or a symmetry"},
    {"grid.x.sponge",
     "layers at both ends of the range that damp what comes there, for waves that leave: fields with an equation of "
     "motion are damped, at a rate that rises smoothly from 0 at the inner edge of a layer to strength at the end of "
     "the range. Beside a wall that drives a field there is none. The run is not Hamiltonian; what the layers take is "
     "counted"},
    {"parameters", "numbers and formulas of each other, in any order", "a parameter"},
    {"definitions",
     "formulas with a name, in any order: of the state, x, y, z, t, parameters and each other, wherever these are "
     "known",
     "a definition"},
    {"initial",
     "where the run starts: for an orbit a number for every coordinate and momentum, or, with [lagrangian], every "
     "coordinate and velocity; for a lattice formulas of x, y, z for the fields that no constraint determines",
     "a coordinate, a momentum, a velocity or a field"},
    {"initial.next",
     "a second level given instead of computed: of an orbit for the two-step form of a scheme, of a lattice for custom",
     "a coordinate, a momentum or a field"},
    {"invariants",
     "formulas that are reported along the run: of q and p, with [lagrangian] of q, q_dot and p_q; on a lattice "
     "densities, summed over the nodes",
     "a quantity"},
    {"exact", "the exact solution as formulas of t, on a lattice of x, y, z and t: the error is reported",
     "a coordinate, a momentum, a velocity or a field"},
    {"symmetries",
     "of a lattice linear ones, z -> z + s B z, each the entries [row, column, value] of B or the whole of it: their "
     "local laws are reported. Of an orbit generators of coordinates, NAME = { x = \"-y\", y = \"x\" }, which move "
     "momenta "
     "as they have to, or linear ones of both: their momentum maps are reported as invariants, with their changes in "
     "each step. find = true adds all other linear symmetries of H, as linear_1, linear_2 and so on",
     "a symmetry"},
    {"constraints",
     "holonomic constraints of an orbit: formulas of the coordinates that vanish, NAME = \"x^2 + y^2 - 1\". With "
     "[lagrangian] any scheme takes them, with [hamiltonian] midpoint does and, for H = T(p) + V(q), splitting",
     "a constraint"},
    {"scheme", "how it is solved"},
    {"scheme.step_potential",
     "a step potential by its numbers: f'(h) = +-(s+1) |eta| h0^s (|h|/(kappa h0))^p, of the first step h0"},
    {"scheme.frame",
     "a frame that moves with the waves of a periodic lattice, where steps may be longer: states are of the frame, at "
     "x = node + /frame/shift; output at times, events and invariants are of the laboratory"},
    {"scheme.frame.phase", "phase = { charge = 0.5 }: how fast the frame turns in a symmetry",
     "a symmetry of the problem"},
    {"scheme.tangents", "tangent vectors of an orbit, with all options: { vectors = \"all\", matrix = true }"},
    {"laws", "local laws: the levels at which they are evaluated, and what is stored"},
    {"verdict", "reasons that the verdict ignores"},
    {"output", "the record"},
    {"levels", "levels and steps in the record"},
    {"output.quantities",
     "formulas that are stored at the output times, or at the stored levels: of q, p and t; on a lattice of fields, "
     "dx(f), t and x, y, z, with integral(f); at one point of it { formula = ..., at = { x = ... } }",
     "a quantity"},
    {"events",
     "zeros of formulas along the run, located between its levels: of q, p and t; on a lattice of t, integral(f), and "
     "of fields at a point. NAME = \"x - 1\": every zero; NAME = \"x > 1\": where that becomes true",
     "an event: a formula, a comparison, or a table as the next one"},
    {"events.NAME", "an event with all options"},
    {"section", "a Poincare section: an event that is drawn on the page, by its first two quantities"},
    {"solve",
     "a boundary-value problem of an orbit, for `rubato solve`: the action is made stationary between two ends. The "
     "guess is the orbit from [initial] until the end that [scheme] states. Of a lattice of one dimension: a periodic "
     "orbit, with ends, period, energy, steps, tolerance and max_iterations"},
    {"solve.ends", "ends = { q_0 = 0, q_1 = \"pi/2\" }: values at the start, NAME_0, and at the end, NAME_1",
     "a coordinate or momentum with _0 or _1"},
    {"solve.jump", "what coordinates and momenta grow by in a period: { q = \"2*pi\" }", "a coordinate or a momentum"},
    {"solve.from", "the equilibrium that a connection leaves", "a coordinate or a momentum"},
    {"solve.to", "the equilibrium that it reaches", "a coordinate or a momentum"},
    {"solve.guess", "formulas of t, instead of [initial]; t is 0 at the start of the orbit",
     "a coordinate or a momentum"},
    {"solve.continue",
     "continue = { parameter = \"energy\", to = 0.1 }: from the solution a branch of solutions is followed until its "
     "parameter comes there, through folds"},
    {"ensemble", "many runs of the problem, each with some of its entries changed: members, grid or random"},
    {"ensemble.random",
     "random = { count = 100, seed = 1, initial.p = \"uniform(0, 2)\" }: random values, by the path of the entry",
     "the first part of an entry's path"},
}};

constexpr auto every_entry = [](const auto&) { return true; };

/// The names of those entries of a registry of which `which` holds.
template <typename Entries, typename Which = decltype(every_entry)>
std::vector<std::string_view> names_of(const Entries& entries, Which which = every_entry) {
  std::vector<std::string_view> words;
  for (const auto& one : entries) {
    if (std::invoke(which, one)) {
      words.push_back(one.name);
    }
  }
  return words;
}

/// Those of orbits, then those of lattices; some are both.
std::vector<std::string_view> all_lagrangians() {
  std::vector<std::string_view> words = names_of(orbit_methods());
  for (const std::string_view word : lattice_lagrangians()) {
    if (std::ranges::find(words, word) == words.end()) {
      words.push_back(word);
    }
  }
  return words;
}

std::vector<KeyEntry> make_keys() {
  const Scheme scheme;
  const Output output;
  const StatedSolve solve;
  const std::string required = "required";
  const std::string none = "none";
  static const std::vector<std::string_view> words = all_lagrangians();
  return {
      {"", "title", "text", "the file's name", "What reports call the problem."},
      {"", "hamiltonian", "table", none, ""},
      {"", "lagrangian", "table", none, ""},
      {"", "multisymplectic", "table", none, ""},
      {"", "field", "table", none, ""},
      {"", "grid", "table", "required for a lattice", ""},
      {"", "parameters", "table", none, ""},
      {"", "definitions", "table", none, ""},
      {"", "initial", "table", required, ""},
      {"", "invariants", "table", none, ""},
      {"", "exact", "table", none, ""},
      {"", "symmetries", "table", none, ""},
      {"", "constraints", "table", none, ""},
      {"", "scheme", "table", required, ""},
      {"", "laws", "table", none, ""},
      {"", "verdict", "table", none, ""},
      {"", "output", "table", none, ""},
      {"", "levels", "table", none, ""},
      {"", "events", "table", none, ""},
      {"", "section", "table", none, ""},
      {"", "solve", "table", none, ""},
      {"", "ensemble", "table", none, ""},

      {"hamiltonian", "q", "list of names", required, "The coordinates; \"r[3]\" declares the vector r1, r2, r3."},
      {"hamiltonian", "p", "list of names", required, "The momenta, in the same order."},
      {"hamiltonian", "H", "formula", required,
       "The Hamiltonian, of coordinates, momenta and parameters; of t, too, for a driven system."},
      {"hamiltonian", "time_scale", "formula", none,
       "A positive g, of the same: the orbit in fictitious time, dt = g dt', in which step and until are then meant. "
       "The time becomes a coordinate called time."},

      {"lagrangian", "q", "list of names", required,
       "The coordinates; \"r[3]\" declares the vector r1, r2, r3, with the velocities r1_dot, r2_dot, r3_dot."},
      {"lagrangian", "L", "formula", required,
       "The Lagrangian, of coordinates, velocities and parameters: \"q_dot^2/2 + cos(q)\". Velocities have to "
       "follow "
       "from "
       "momenta: its second derivatives by them form a matrix with an inverse."},

      {"multisymplectic", "fields", "list of names", required, "The fields z; \"r[3]\" declares r1, r2, r3."},
      {"multisymplectic", "M", "matrix", required,
       "Of z_t, skew: a list of entries [\"row\", \"column\", value], each with the opposite one across the diagonal, "
       "or "
       "all rows in full."},
      {"multisymplectic", "K", "table", required, "See [multisymplectic.K]; written K.x = ..."},
      {"multisymplectic", "S", "formula", required,
       "Of the fields and parameters; of the grid's x, y, z, too, for a medium that is not the same everywhere, and of "
       "t "
       "for a driven system."},
      {"multisymplectic.K", "x", "matrix", required, "Of z_x, as M."},
      {"multisymplectic.K", "y", "matrix", "required if the grid has y", "Of z_y."},
      {"multisymplectic.K", "z", "matrix", "required if the grid has z", "Of z_z."},

      {"field", "equation", "text or list of texts", "required without L and H",
       "The equation itself, \"u_tt = u_xx - sin(u)\", or one for each field: a Lagrangian is looked for. Complex: "
       "\"i*psi_t + "
       "psi_xx + 2*abs2(psi)*psi = 0\", with psi."},
      {"field", "fields", "list of names", "required without equation",
       "The fields that the density is of; \"r[3]\" declares r1, r2, r3."},
      {"field", "L", "formula", "required without H and equation",
       "The Lagrangian density, of the fields, their derivatives, x, y, z, t and parameters: \"u_t^2/2 - u_x^2/2 - (1 "
       "- "
       "cos(u))\"."},
      {"field", "H", "formula", "required without L and equation",
       "The Hamiltonian density, of the same, without derivatives by t."},
      {"field", "structure", "word", "required with H",
       "How H moves the fields: canonical, u_t = dH/dv, v_t = -dH/du; dx, u_t = d/dx dH/du; schroedinger, i psi_t = "
       "dH/d(conjugate psi); dx/(1-dxx), u_t - u_xxt = d/dx dH/du.",
       structure_words},
      {"field", "pairs", "list of pairs", none,
       "The pairs [\"u\", \"v\"] of canonical; with dx, u_t = d/dx dH/dv, v_t = d/dx dH/du."},
      {"field", "psi", "two names, or list of such pairs", "required with schroedinger",
       "The real and the imaginary part of psi, or of psi1, psi2, ...; of equations with i, abs2 or conj p and q, or "
       "p1, q1, ... where it is left out."},

      {"grid", "x", "table", required, "See [grid.x]; written x = { from = ..., to = ..., cells = ... }."},
      {"grid", "y", "table", none, "The second direction."},
      {"grid", "z", "table", none, "The third direction."},
      {"grid.x", "from", "number", required, "Where the period begins: the first node."},
      {"grid.x", "to", "number", required, "Where it ends: the first node again."},
      {"grid.x", "cells", "integer, at least 3, or \"about N\"", required,
       "Nodes in a period. \"box\" needs odd numbers; transforms are fast with small prime factors. \"about N\" is the "
       "number nearest to N that the scheme takes and is quick with."},
      {"grid.x", "jump", "table", none, "See [grid.x.jump]; each entry is a number."},
      {"grid.x", "phase", "table", none, "See [grid.x.phase]; each entry is an angle."},
      {"grid.x", "sponge", "table", none, "See [grid.x.sponge]; sponge = { width = 10, strength = 2 }."},
      {"grid.x.sponge", "width", "number", required, "How far each layer reaches into the range: some wavelengths."},
      {"grid.x.sponge", "strength", "number", required, "The largest rate of the damping, at the end of the range."},
      {"grid.x", "left", "\"fixed\", \"free\" or a table", "the period begins",
       "The wall at from. A fixed one holds fields at their initial values there; at a free one they vary, and their "
       "slope is 0. left = { u = \"sin(t)\" } gives a field its values, by a formula of t and the coordinates: "
       "box, leapfrog and explicit actions, fixed levels."},
      {"grid.x", "right", "\"fixed\", \"free\" or a table", "the period ends", "The wall at to; with left only."},

      {"initial", "t", "number", "0", "The time of the start."},
      {"initial", "from", "text", none,
       "A record: what is not given here is taken from one of its states, and its time is that of the start. Or a "
       "table, NAME.csv: a line of names, then rows of numbers; on a lattice one for each node, with x, y, z where it "
       "is. Or datasets of another HDF5 file, \"data.h5\" or \"data.h5:/group\", with the names of what they give."},
      {"initial", "at", "number", "the last",
       "Of from: the stored level nearest to this time; of datasets, by their t."},
      {"initial", "take", "list of names", "those that it was given itself",
       "Of from, on a lattice: the fields that are read, by Fourier interpolation if the number of cells differs."},
      {"initial", "next", "table", none, "See [initial.next]."},
      {"initial.next", "t", "number", required, "The time of the second level."},

      {"scheme", "lagrangian", "word",
       fmt::format("{} for orbits, {} for lattices", hamiltonian_lagrangians()[0], lattice_lagrangians()[0]),
       fmt::format("The discrete Lagrangian, or the family of symplectic maps; for orbits {}, for [lagrangian] the "
                   "quadratures of the action {}, for lattices {}.",
                   fmt::join(hamiltonian_lagrangians(), ", "), fmt::join(quadratures(), ", "),
                   fmt::join(lattice_lagrangians(), ", ")),
       words},
      {"scheme", "levels", "word", std::string(to_string(scheme.levels)),
       "Levels from the total variation, which keep the discrete energy, or equal ones.", levels_words},
      {"scheme", "step", "number, or \"auto\"", required,
       "The first step t_1 - t_0, with the sign of until - start; \"auto\" chooses it for energy_tolerance."},
      {"scheme", "until", "number", required, "The run ends at the first level at or past this time."},
      {"scheme", "energy_tolerance", "number between 0 and 1", "required by step = \"auto\"",
       "The largest relative deviation of the node energy that is allowed."},
      {"scheme", "on_singular", "word", std::string(to_string(scheme.on_singular)),
       "If no step keeps the discrete energy: take plain steps, which are counted as off the law, or stop.",
       on_singular_words},
      {"scheme", "step_potential", "word, or table",
       fmt::format("{}; {} where on_singular is given", potential_words[1], potential_words[0]),
       "A function of the step size in the conserved energy, which makes a next level exist everywhere: chosen by a "
       "look-ahead along the orbit, or stated by its numbers.",
       potential_words},
      {"scheme", "largest_step", "number", none, "The approximate largest step, for step_potential = \"auto\"."},
      {"scheme", "time_scale", "formula", none, "The same as in [hamiltonian]."},
      {"scheme", "frame", "table", none, "Of a lattice, see [scheme.frame]."},
      {"scheme", "tangents", "integer, \"all\", or table", "0",
       "Of an orbit, the number of tangent vectors: for Lyapunov exponents, MEGNO and the defect of the two-form."},
      {"scheme.tangents", "vectors", "integer, or \"all\"", "0",
       "The number of vectors that are made orthonormal after each step."},
      {"scheme.tangents", "matrix", "true or false", "false",
       "Store the state-transition matrix, the derivative of each stored state by the first."},
      {"scheme.tangents", "parameters", "list of names", none,
       "Store the derivatives of each stored state by these entries of [parameters]."},
      {"scheme.frame", "velocity", "number, list, or \"fit\"", "0",
       "That of the frame; of two and three dimensions a list, [c_x, c_y]; \"fit\" takes the one in which the initial "
       "fields change least."},
      {"scheme.frame", "phase", "table", none, "See [scheme.frame.phase]; its entry is a number, or \"fit\"."},
      {"scheme.step_potential", "kappa", "number", required, "kappa h0 is about the largest step."},
      {"scheme.step_potential", "p", "number greater than the order", required,
       "The exponent: the larger, the more suddenly f' grows."},
      {"scheme", "order", "integer", "required by generating",
       "The order of a generating function; with splitting 2, 4, 6 or 8, for the best splitting of that order."},
      {"scheme", "stages", "integer from 1 to 8", "required by gauss and lobatto; 1 for box and fourier",
       "The stages of Gauss collocation in time, of order 2*stages; or Lobatto's points, 2 to 9, of order 2*stages - "
       "2."},
      {"scheme", "space_stages", "1 or 3", fmt::format("{}", scheme.space_stages),
       "The stages of Gauss collocation in space, of order 2*space_stages; of box, on a line, whose number of cells is "
       "then an odd multiple of them."},
      {"scheme", "composition", "word", scheme.composition,
       "Of splitting: the flows that are composed; the number is the order, golden and verlet have 2. rkn is for T(p) "
       "of degree two, and on lattices for kicks.",
       composition_words()},
      {"scheme", "space", "word", scheme.space,
       "Of a lattice's splitting: spectral derivatives, or differences of neighbours, of second order.", space_words},
      {"scheme", "darboux", "word, or matrix", std::string(darboux_words[0]),
       "The type of a generating function; as a matrix a symmetric 2n x 2n one, in full.", darboux_words},
      {"scheme", "L", "formula", "required by custom",
       "The discrete Lagrangian, of t_0, t_1 and every coordinate and momentum with _0 and _1: q_0, q_1; the action of "
       "a step is (t_1 - t_0)*L. On a lattice a density of the corners of a cell: u_00, u_01, u_10, u_11 (level, node; "
       "in the plane u_000: level, y, x), h, dx, dy, dz, x, y, z."},
      {"scheme", "allow_unstable", "true or false", scheme.allow_unstable ? "true" : "false",
       "Allows forward to run for more than a few steps, although it is unstable."},
      {"scheme", "max_steps", "integer, at least 1", fmt::format("{}", scheme.max_steps),
       "The run ends after this number of steps."},
      {"scheme", "tolerance", "number between 0 and 1", fmt::format("{}", scheme.tolerance),
       "Of the discrete energy in each step, relative. The step itself is always solved to rounding error."},

      {"laws", "every", "integer, at least 1, or false (\"off\")", "1",
       "Local laws, totals and invariants are evaluated at every n-th level and step, or never; the energy always."},
      {"laws", "fields", "true or false", "false",
       "Store the residual of each local law in every cell, over the step to each stored level."},

      {"verdict", "accept", "list of words", none,
       fmt::format("Reasons that do not count in the verdict: {}. The run names those that it found.",
                   fmt::join(figures::reason_words, ", ")),
       figures::reason_words},

      {"output", "file", "text", "the problem's name with .h5", "The record, relative to the current folder."},
      {"output", "every", "integer, at least 1", fmt::format("{}", output.every),
       "Every n-th level is stored, and the first and the last."},
      {"output", "states", "true or false", output.states ? "true" : "false",
       "false: store the first and the last level only (of a lattice the fields with an equation of motion), and at "
       "output times quantities without states."},
      {"output", "times", "list of numbers", none,
       "Additional output times. Values come from dense output; no step is shortened."},
      {"output", "interval", "number", none,
       "Instead of times: output at the start, and from there at equal intervals."},
      {"output", "quantities", "table", none, "See [output.quantities]."},
      {"output", "durable", "true or false", output.durable ? "true" : "false",
       "Each version of the record is flushed to the disk before it replaces the last one."},
      {"output", "compression", "integer from 0 to 9", fmt::format("{}", output.compression),
       "Level of compression: 0 is none, and fastest."},

      {"levels", "every", "integer, at least 1", "output.every",
       "Store a row of every n-th level, of the step that ends there, and of the last level. Extremes and means are of "
       "all levels."},

      {"events", "stop", "formula or comparison", none,
       "The run ends with the step in which it is met: \"x^2 + y^2 > 100\", or { crossing = ... } with more entries."},
      {"events.NAME", "crossing", "formula or comparison", required,
       "A formula that passes zero, or a comparison that becomes true."},
      {"events.NAME", "direction", "word", std::string(direction_words[0]), "The sign of the change, along the run.",
       direction_words},
      {"events.NAME", "at", "table", "required for fields", "On a lattice, the point of the fields: { x = 3.5 }."},
      {"events.NAME", "stop", "true, false, or integer, at least 1", "false (true if called stop)",
       "The run ends with the step of the first crossing, or of the n-th."},
      {"events.NAME", "quantities", "list of formulas", none,
       "Values stored at each crossing, besides the time and the state of an orbit; on a lattice numbers."},
      {"section", "crossing", "formula or comparison", required, "As in [events.NAME]."},
      {"section", "direction", "word", std::string(direction_words[0]), "As in [events.NAME].", direction_words},
      {"section", "at", "table", "required for fields", "As in [events.NAME]."},
      {"section", "stop", "true, false, or integer, at least 1", "false", "As in [events.NAME]."},
      {"section", "quantities", "list of formulas", required, "The coordinates of the section: [\"y\", \"v\"]."},

      {"solve", "ends", "word, table, or list of equations", required,
       "periodic; symmetric, half of a periodic orbit, from one turn of the motion to the next; connection, between "
       "two "
       "equilibria; values at both ends, { q_0 = 0, q_1 = 1 }; or equations in these, [\"x_1 = -2*y_0\"].",
       ends_words},
      {"solve", "jump", "table", none, "Of periodic: see [solve.jump]."},
      {"solve", "mirror", "list of names", "required by symmetric",
       "What changes sign when the motion is reversed, one of each pair: [\"y\", \"px\"]. It is 0 at both ends of the "
       "half."},
      {"solve", "from", "table", "required by connection", "See [solve.from]; written from = { q = 0, p = 0 }."},
      {"solve", "to", "table", "required by connection", "See [solve.to]."},
      {"solve", "time", "number, or \"free\"", "until - t; free where an energy is given",
       "From the start to the end, with ends that are not periodic or symmetric.", free_words},
      {"solve", "period", "number, or \"free\"", "until - t; free where an energy is given", "Of an orbit that closes.",
       free_words},
      {"solve", "energy", "number, or a word", std::string(solve_energy_words[0]),
       "Of the discrete energy K without its step potential, the mean over time; initial is H at [initial].",
       solve_energy_words},
      {"solve", "steps", "integer, at least 1", "(until - t)/step", "The number of steps of the orbit."},
      {"solve", "guess", "table", none, "See [solve.guess]."},
      {"solve", "starts", "list of tables", none,
       "Further guesses, tried in order until one leads to a solution. Each has entries in place of those of "
       "[initial], "
       "or of guess: [{ p = 1.2 }, { p = 2.3 }]."},
      {"solve", "continue", "table", none, "See [solve.continue]."},
      {"solve.continue", "parameter", "word, or name", required,
       "energy; period, or time; or a number of [parameters] that H names."},
      {"solve.continue", "to", "number", required, "Where the branch ends: the record has the solution there."},
      {"solve.continue", "step", "number", "a twentieth of the way",
       "Of the parameter, in the first step; its sign is the direction in which the branch sets out."},
      {"solve.continue", "points", "integer, at least 1", "500", "It ends after so many solutions."},
      {"solve", "tolerance", "number between 0 and 1", fmt::format("{}", solve.tolerance),
       "Of what the solution may leave of any equation, relative to the size of its terms."},
      {"solve", "max_iterations", "integer, at least 1", fmt::format("{}", solve.most_iterations),
       "Of Newton's method, each time that it is begun."},

      {"ensemble", "members", "list of tables", none,
       "One table for each member, of the same entries: [{ initial.p = 1, parameters.k = 1 }, { initial.p = 1.5, "
       "parameters.k = 2 }]."},
      {"ensemble", "grid", "table", none,
       "All combinations: { initial.p = \"0:2:21\", parameters.k = [1, 2] }, from:to:count or a list for each entry; "
       "the last one changes first."},
      {"ensemble", "random", "table", none, "See [ensemble.random]."},
      {"ensemble.random", "count", "integer, at least 1", required, "The number of members."},
      {"ensemble.random", "seed", "integer, at least 0", "1", "The same seed gives the same members."},
  };
}

/// "grid.y" and "grid.z", and their tables, are documented as those of "grid.x", "events." and any name as
/// "events.NAME".
std::string_view documented_name(std::string_view table) {
  constexpr std::string_view x = "grid.x";
  if (table.starts_with("grid.y") || table.starts_with("grid.z")) {
    const auto found = std::ranges::find_if(all_tables, [&](const TableEntry& entry) {
      return entry.name.starts_with(x) && entry.name.substr(x.size()) == table.substr(x.size());
    });
    return found == all_tables.end() ? table : std::string_view(found->name);
  }
  return table.starts_with("events.") ? "events.NAME" : table;
}

}  // namespace

std::span<const std::string_view> hamiltonian_lagrangians() {
  static const std::vector<std::string_view> words = names_of(orbit_methods(), &OrbitMethod::of_hamiltonian);
  return words;
}
std::span<const std::string_view> quadratures() {
  static const std::vector<std::string_view> words = names_of(orbit_methods(), &OrbitMethod::of_lagrangian);
  return words;
}
std::span<const std::string_view> lattice_lagrangians() {
  static const std::vector<std::string_view> words = [] {
    std::vector<std::string_view> names = names_of(lattice_methods());
    names.push_back(custom_lattice_method().name);
    return names;
  }();
  return words;
}
std::span<const std::string_view> composition_words() {
  static const std::vector<std::string_view> words = names_of(compositions());
  return words;
}

std::span<const TableEntry> problem_tables() {
  return all_tables;
}

std::span<const KeyEntry> problem_keys() {
  static const std::vector<KeyEntry> keys = make_keys();
  return keys;
}

std::vector<std::string_view> keys_of(std::string_view table) {
  std::vector<std::string_view> names;
  for (const KeyEntry& key : problem_keys()) {
    if (key.table == table) {
      names.push_back(key.name);
    }
  }
  return names;
}

std::optional<std::string_view> table_of(std::string_view key) {
  std::optional<std::string_view> table;
  for (const KeyEntry& known : problem_keys()) {
    // [events] stands for those of events; those of [solve] that other tables have are likelier meant there.
    const bool is_elsewhere =
        known.table == "events.NAME" || known.table == "section" || known.table.starts_with("solve");
    if (known.name == key && !is_elsewhere) {
      if (table) {
        return std::nullopt;
      }
      table = known.table;
    }
  }
  return table && !table->empty() ? table : std::nullopt;
}

bool is_documented(std::string_view table, std::string_view key) {
  const std::string_view name = documented_name(table);
  const auto entry = std::ranges::find(problem_tables(), name, &TableEntry::name);
  if (entry == problem_tables().end()) {
    return false;
  }
  return !entry->names_what.empty() || std::ranges::any_of(problem_keys(), [&](const KeyEntry& known) {
    return known.table == name && known.name == key;
  });
}

}  // namespace rubato
