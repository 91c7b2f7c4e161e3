# The kernels of the batch evaluator and of Taylor arithmetic are each one source compiled once per instruction set and
# chosen at run time. FMA is left out on purpose: without it all variants round alike and a record does not depend on the
# machine that wrote it. The kernels are optimised in every build type, so that no inline function of a header stays
# behind, compiled for an instruction set that the linker knows nothing of.
foreach(kernel IN ITEMS pair avx2 avx512)
  set(options -O3)
  if(NOT CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
    # The sources of kernels that other machines do not have are empty there.
  elseif(kernel STREQUAL avx2)
    list(APPEND options -mavx2)
  elseif(kernel STREQUAL avx512)
    # The warnings are false ones of g++ 12 about its own intrinsics.
    list(APPEND options -mavx512f -mavx512cd -mavx512dq -mavx512bw
      $<$<CXX_COMPILER_ID:GNU>:-Wno-uninitialized> $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  endif()
  foreach(source IN ITEMS batch taylor)
    set_source_files_properties(${PROJECT_SOURCE_DIR}/formula/${source}_${kernel}.cpp PROPERTIES
      COMPILE_OPTIONS "${options}" SKIP_PRECOMPILE_HEADERS ON)
  endforeach()
endforeach()
