# How the library is compiled: -O2, which is enough for nearly all of it and compiles faster, -O3 where loops over cells
# or orders are, and -O1 for rooms that read, compare and tell. None changes a result.
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
    pde/cell_sweep.cpp pde/euler_box_map.cpp pde/face_gather.cpp pde/midpoint_lattice.cpp pde/wave_loops.cpp)
  list(TRANSFORM loops PREPEND ${PROJECT_SOURCE_DIR}/)
  set_source_files_properties(${loops} PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O3>")
  # A fallback for rare systems, and most of a large library.
  set_source_files_properties(${PROJECT_SOURCE_DIR}/solve/cyclic_sparse.cpp PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O1>")
endfunction()

# rubato_optimise_little(<target>): a fifth less to compile. Small functions, the accessors of containers above all, are
# still put in place.
function(rubato_optimise_little target)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>
    $<$<AND:$<CONFIG:Release>,$<CXX_COMPILER_ID:GNU>>:-finline-small-functions>)
endfunction()

# A first build is spent on the same templates again and again. So what nearly every source includes is compiled once,
# and the sources of a room ten at a time: one that was edited is then compiled with its neighbours, in some seconds.
# With ccache each source stands for itself and includes what it says it does, and so it does in the folders of the other
# presets. Sources that are compiled together see each other's unnamed namespaces: in these, a room uses a name once.
set(together OFF)
if(NOT CCACHE AND CMAKE_BUILD_TYPE STREQUAL Release)
  set(together ON)
endif()
option(RUBATO_PRECOMPILE "Precompile the headers that most sources include" ${together})
option(RUBATO_UNITY "Compile the sources of a room several at a time" ${together})
set(RUBATO_UNITY_BATCH 10 CACHE STRING "How many sources are compiled together")
mark_as_advanced(RUBATO_UNITY_BATCH)
if(RUBATO_UNITY)
  add_library(rubato_unity_warnings INTERFACE)   # two that are about nothing but this
  target_compile_options(rubato_unity_warnings INTERFACE -Wno-shadow $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()
if(RUBATO_PRECOMPILE)
  add_library(rubato_headers OBJECT ${PROJECT_SOURCE_DIR}/cmake/headers.cpp)
  target_compile_features(rubato_headers PRIVATE cxx_std_20)
  target_link_libraries(rubato_headers PRIVATE fmt::fmt Eigen3::Eigen OpenMP::OpenMP_CXX rubato_warnings)
  target_precompile_headers(rubato_headers PRIVATE ${PROJECT_SOURCE_DIR}/cmake/headers.hpp)
  set_target_properties(rubato_headers PROPERTIES POSITION_INDEPENDENT_CODE ON)
endif()

# rubato_compile_together(<target>): for a room's library. Precompiled headers serve sources compiled with the same flags
# alone, so that every room gets OpenMP's; sources with options of their own are left out of both.
function(rubato_compile_together target)
  if(RUBATO_UNITY)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${RUBATO_UNITY_BATCH})
    target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:rubato_unity_warnings>)
  endif()
  if(RUBATO_PRECOMPILE)
    target_compile_options(${target} PRIVATE ${OpenMP_CXX_FLAGS})
    target_precompile_headers(${target} REUSE_FROM rubato_headers)
  endif()
endfunction()
