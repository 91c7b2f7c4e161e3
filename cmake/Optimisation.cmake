# How the library is compiled: -O2, which is enough for nearly all of it and compiles faster, and -O3 where loops over
# cells or orders are. Neither changes a result.
if(CMAKE_CXX_COMPILER_ID MATCHES "GNU|Clang" AND PROJECT_IS_TOP_LEVEL)
  string(REPLACE "-O3" "-O2" CMAKE_CXX_FLAGS_RELEASE "${CMAKE_CXX_FLAGS_RELEASE}")
endif()

# rubato_optimise_loops(): the sources with such loops. (Those of cmake/FormulaKernels.cmake besides.)
function(rubato_optimise_loops)
  set(loops
    formula/evaluate.cpp
    grids/box_operators.cpp grids/fourier.cpp grids/spectral_derivative.cpp
    solve/chunk_elimination_avx2.cpp solve/chunk_elimination_avx512.cpp solve/cyclic_block.cpp
    solve/fourier_preconditioner.cpp solve/gmres.cpp
    pde/cell_sweep.cpp pde/euler_box_map.cpp pde/face_gather.cpp pde/midpoint_lattice.cpp)
  list(TRANSFORM loops PREPEND ${PROJECT_SOURCE_DIR}/)
  set_source_files_properties(${loops} PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O3>")
  # A fallback for rare systems, and most of a large library.
  set_source_files_properties(${PROJECT_SOURCE_DIR}/solve/cyclic_sparse.cpp PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O1>")
endfunction()

# What nearly every source includes, compiled once. With ccache each source includes what it says it does, and so it
# does in the folders of the other presets.
set(precompile OFF)
if(NOT CCACHE AND CMAKE_BUILD_TYPE STREQUAL Release)
  set(precompile ON)
endif()
option(RUBATO_PRECOMPILE "Precompile the headers that most sources include" ${precompile})
if(RUBATO_PRECOMPILE)
  add_library(rubato_headers OBJECT ${PROJECT_SOURCE_DIR}/cmake/headers.cpp)
  target_compile_features(rubato_headers PRIVATE cxx_std_20)
  target_link_libraries(rubato_headers PRIVATE fmt::fmt Eigen3::Eigen OpenMP::OpenMP_CXX rubato_warnings)
  target_precompile_headers(rubato_headers PRIVATE ${PROJECT_SOURCE_DIR}/cmake/headers.hpp)
  set_target_properties(rubato_headers PROPERTIES POSITION_INDEPENDENT_CODE ON)
endif()

# rubato_precompile(<target>): lets a library use them. They serve sources compiled with the same flags alone, so that
# every room gets OpenMP's.
function(rubato_precompile target)
  if(RUBATO_PRECOMPILE)
    target_compile_options(${target} PRIVATE ${OpenMP_CXX_FLAGS})
    target_precompile_headers(${target} REUSE_FROM rubato_headers)
  endif()
endfunction()
