# How the library is compiled, in three kinds of sources: `loops` over cells or orders by -O3; what else is done in `steps`
# by -O2; and by -Og, which takes a third less time, what is done `once` in a run or not at all: what reads, states,
# compares and tells. None changes a result.
if(CMAKE_CXX_COMPILER_ID MATCHES "GNU|Clang" AND PROJECT_IS_TOP_LEVEL)
  string(REPLACE "-O3" "-O2" CMAKE_CXX_FLAGS_RELEASE "${CMAKE_CXX_FLAGS_RELEASE}")
endif()

# The kernels of cmake/FormulaKernels.cmake have options of their own.
set(rubato_sources_loops
  base/all_finite.cpp
  formula/evaluate.cpp formula/loop_evaluator.cpp
  ode/splitting_lanes.cpp ode/stage_kernels.cpp ode/state_kernels.cpp
  grids/arrays.cpp grids/box_operators.cpp grids/fourier.cpp grids/reductions.cpp grids/spectral_derivative.cpp grids/stencil.cpp
  solve/band_solver.cpp solve/block_qr_reduction.cpp solve/cyclic_block.cpp solve/cyclic_residual.cpp solve/fourier_preconditioner.cpp solve/gmres.cpp
  pde/box_gather.cpp pde/box_lattice.cpp pde/cell_sweep.cpp pde/cell_sweep_size.cpp pde/euler_box_map.cpp pde/face_gather.cpp pde/law_currents.cpp pde/level_fields.cpp pde/level_history.cpp pde/wave_loops.cpp
  record/checksum.cpp)
# Where a room's sources are of two kinds, those that are not of its first.
set(rubato_sources_once
  formula/batch_program.cpp formula/branches.cpp formula/bytecode.cpp formula/changed_term.cpp formula/differentiate.cpp formula/divisors.cpp formula/executable_memory.cpp formula/expression.cpp
  formula/language.cpp formula/loop.cpp formula/loop_builder.cpp formula/loop_program.cpp formula/machine_code.cpp formula/operand.cpp formula/parse.cpp formula/parse_error.cpp formula/partials.cpp formula/reachable.cpp
  formula/single_assignment.cpp formula/sum.cpp formula/taylor_program.cpp formula/tokens.cpp formula/transform.cpp
  solve/cyclic_sparse.cpp   # a fallback for rare systems, and most of a large library
  variation/action_quadrature.cpp variation/composition.cpp variation/first_step.cpp
  variation/formula_action.cpp variation/lattice_action.cpp variation/run_span.cpp
  variation/total_variation.cpp
  ode/boundary_value.cpp ode/continuation.cpp ode/custom_consistency.cpp ode/darboux.cpp ode/discrete_lagrangian.cpp ode/end_conditions.cpp ode/first_step.cpp ode/flow_map.cpp
  ode/node_law.cpp ode/orbit_between.cpp ode/separable.cpp ode/splitting_formula.cpp ode/tangent.cpp ode/taylor_code.cpp
  pde/action_consistency.cpp pde/action_kernel.cpp pde/action_rows.cpp pde/antiderivative.cpp pde/dispersion.cpp
  pde/field_structure.cpp pde/first_step.cpp pde/initial_agreement.cpp pde/initial_level.cpp pde/initial_sawtooths.cpp
  pde/inverse_problem.cpp pde/jet_polynomial.cpp
  pde/kernel_conditions.cpp pde/lattice.cpp pde/lattice_actions.cpp pde/lattice_between.cpp pde/lattice_method.cpp
  pde/law_tables.cpp pde/linear_symmetries.cpp pde/local_laws.cpp pde/mean_conditions.cpp pde/mirror_signs.cpp
  pde/multisymplectic_form.cpp pde/multisymplectic_system.cpp pde/natural_sizes.cpp pde/periodicity.cpp
  pde/point_symmetries.cpp pde/potential_rest.cpp pde/random_points.cpp pde/stated_action.cpp pde/wall_data.cpp
  pde/well_posedness.cpp pde/schemes/box.cpp pde/schemes/euler_box.cpp pde/schemes/fourier.cpp
  pde/schemes/leapfrog.cpp pde/schemes/splitting.cpp)
set(rubato_sources_steps
  figures/statistics.cpp
  record/writer.cpp
  run/observed_run.cpp run/ensemble_lanes.cpp run/ensemble_member.cpp run/events.cpp run/lattice_events.cpp run/lattice_residuals.cpp run/lattice_simulation.cpp
  run/law.cpp run/level_rows.cpp run/memory_record.cpp run/orbit_events.cpp run/orbit_simulation.cpp run/recorder.cpp run/run.cpp)
# rubato_kind_of(<source> <default> <variable>)
function(rubato_kind_of source default result)
  foreach(kind IN ITEMS loops once steps)
    if(source IN_LIST rubato_sources_${kind})
      set(${result} ${kind} PARENT_SCOPE)
      return()
    endif()
  endforeach()
  set(${result} ${default} PARENT_SCOPE)
endfunction()

# A first build is spent on the same templates again and again. So what nearly every source includes is compiled once,
# and the sources of a room sixteen at a time: one that was edited is then compiled with its neighbours, in some seconds.
# With ccache each source stands for itself and includes what it says it does, and so it does in the folders of the other
# presets. Sources that are compiled together see each other's unnamed namespaces: in these, a room uses a name once.
set(together OFF)
if(NOT CCACHE AND CMAKE_BUILD_TYPE STREQUAL Release)
  set(together ON)
endif()
option(RUBATO_PRECOMPILE "Precompile the headers that most sources include" ${together})
option(RUBATO_UNITY "Compile the sources of a room several at a time" ${together})
set(RUBATO_UNITY_BATCH 16 CACHE STRING "How many sources are compiled together")
mark_as_advanced(RUBATO_UNITY_BATCH)
if(RUBATO_UNITY)
  add_library(rubato_together INTERFACE)
  # Two warnings are about nothing but this.
  target_compile_options(rubato_together INTERFACE -Wno-shadow $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
  # So many kB before the compiler looks for memory that it no longer needs.
  target_compile_options(rubato_together INTERFACE
    $<$<CXX_COMPILER_ID:GNU>:--param=ggc-min-heapsize=400000>)
endif()
if(RUBATO_PRECOMPILE)
  add_library(rubato_headers OBJECT ${PROJECT_SOURCE_DIR}/cmake/headers.cpp)
  target_compile_features(rubato_headers PRIVATE cxx_std_20)
  target_link_libraries(rubato_headers PRIVATE fmt::fmt Eigen3::Eigen OpenMP::OpenMP_CXX rubato_warnings)
  target_precompile_headers(rubato_headers PRIVATE ${PROJECT_SOURCE_DIR}/cmake/headers.hpp)
  set_target_properties(rubato_headers PROPERTIES POSITION_INDEPENDENT_CODE ON)
endif()

# rubato_compile_as(<loops, steps or once> <target>). Precompiled headers impose the options that they were compiled with,
# -O among them: they serve what has no -O of its own alone, all of which gets OpenMP's therefore.
function(rubato_compile_as kind target)
  if(RUBATO_UNITY)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${RUBATO_UNITY_BATCH})
    target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:rubato_together>)
  endif()
  if(kind STREQUAL "loops")
    target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O3>)
  elseif(kind STREQUAL "once")
    target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-Og>)
  elseif(RUBATO_PRECOMPILE)
    target_compile_options(${target} PRIVATE ${OpenMP_CXX_FLAGS})
    target_precompile_headers(${target} REUSE_FROM rubato_headers)
  endif()
endfunction()
