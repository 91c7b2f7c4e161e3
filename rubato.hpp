#pragma once

/// \file
/// Everything a user of the library needs: orbits and discrete Lagrangians, generating functions, lattices, the
/// discrete total variation behind them all, problem files and runs, records and reports. A header of a single room
/// serves as well, such as <rubato/ode/integrate.hpp>.

#include <rubato/formula/parse.hpp>
#include <rubato/ode/boundary_value.hpp>
#include <rubato/ode/constraints.hpp>
#include <rubato/ode/continuation.hpp>
#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/first_step.hpp>
#include <rubato/ode/gauss_function.hpp>
#include <rubato/ode/gauss_scheme.hpp>
#include <rubato/ode/generating_function.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/lagrangian.hpp>
#include <rubato/ode/lagrangian_scheme.hpp>
#include <rubato/ode/legendre.hpp>
#include <rubato/ode/orbit_between.hpp>
#include <rubato/ode/orbit_events.hpp>
#include <rubato/ode/second_variation.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_scheme.hpp>
#include <rubato/pde/field_system.hpp>
#include <rubato/pde/first_step.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/problem/browse.hpp>
#include <rubato/problem/help.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/csv.hpp>
#include <rubato/report/page.hpp>
#include <rubato/report/xdmf.hpp>
#include <rubato/run/advise.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/memory_record.hpp>
#include <rubato/run/record_notes.hpp>
#include <rubato/run/run.hpp>
#include <rubato/run/solve.hpp>
#include <rubato/run/version.hpp>
#include <rubato/variation/composition.hpp>
#include <rubato/variation/crossing.hpp>
#include <rubato/variation/formula_action.hpp>
#include <rubato/variation/time_levels.hpp>
#include <rubato/variation/total_variation.hpp>
