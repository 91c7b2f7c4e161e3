# Every package the product needs, found once. Debian's names are in packages.txt beside this file.
include(CheckCXXSourceCompiles)

# rubato_link(<target> <name> SOURCE <source> SHARED <libraries or targets> [STATIC <libraries>…] [INCLUDES <folders>…]).
# To load shared libraries is a good part of what a short run takes. Programs of ours, targets with RUBATO_OWN_LIBRARIES,
# have the static ones in themselves, of which they link what they use, if <source> can be linked with these: what they need
# may be missing, or not be named. RUBATO_<name>_IS_STATIC says so. Others that link rubato may be libraries, and have the
# shared ones.
function(rubato_link target name)
  cmake_parse_arguments(PARSE_ARGV 2 arg "" "SOURCE" "SHARED;STATIC;INCLUDES")
  set(CMAKE_REQUIRED_INCLUDES ${arg_INCLUDES})
  set(CMAKE_REQUIRED_LIBRARIES ${arg_STATIC})
  if(arg_STATIC)
    check_cxx_source_compiles("${arg_SOURCE}" RUBATO_${name}_IS_STATIC)
  endif()
  set(libraries ${arg_SHARED})
  if(arg_STATIC AND RUBATO_${name}_IS_STATIC)
    set(own $<BOOL:$<TARGET_PROPERTY:RUBATO_OWN_LIBRARIES>>)
    set(libraries $<IF:${own},${arg_STATIC},${arg_SHARED}>)
    target_link_options(${target} INTERFACE "$<BUILD_INTERFACE:$<${own}:LINKER:--as-needed>>")
  endif()
  target_link_libraries(${target} INTERFACE "$<BUILD_INTERFACE:${libraries}>" "$<INSTALL_INTERFACE:${arg_SHARED}>")
endfunction()

# rubato_archives(<variable> <names> <libraries>…): those libraries, static ones in place of the shared ones of which the
# name is one of <names>, a|b|c, and beside which they lie; none if there is no static one.
function(rubato_archives variable names)
  set(archives)
  foreach(library IN LISTS ARGN)
    string(REGEX REPLACE "(/lib(${names}))\\.so$" "\\1.a" archive "${library}")
    if(EXISTS "${archive}")
      list(APPEND archives "${archive}")
    else()
      list(APPEND archives "${library}")
    endif()
  endforeach()
  if(archives STREQUAL ARGN)
    set(archives)
  endif()
  set(${variable} ${archives} PARENT_SCOPE)
endfunction()

find_package(fmt REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(OpenMP REQUIRED COMPONENTS CXX)
find_package(xtl REQUIRED)   # xsimd's config needs it found first
find_package(xsimd REQUIRED)
find_package(tomlplusplus REQUIRED)
find_package(CLI11 REQUIRED)

# Machine code for formulas; without it they are interpreted.
option(RUBATO_JIT "Compile formulas to machine code" ON)
add_library(rubato_asmjit INTERFACE)
set_target_properties(rubato_asmjit PROPERTIES EXPORT_NAME asmjit)
if(RUBATO_JIT AND CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
  find_library(ASMJIT_LIBRARY asmjit)
  find_path(ASMJIT_INCLUDE_DIR asmjit/x86.h)
  if(ASMJIT_LIBRARY AND ASMJIT_INCLUDE_DIR)
    # Debian's archive is for programs. Targets with RUBATO_ASMJIT, which are loaded into a process, link the one that this
    # property names (python/CMakeLists.txt).
    set(other $<TARGET_PROPERTY:RUBATO_ASMJIT>)
    target_link_libraries(rubato_asmjit INTERFACE "$<BUILD_INTERFACE:$<IF:$<BOOL:${other}>,${other},${ASMJIT_LIBRARY}>>"
      "$<INSTALL_INTERFACE:${ASMJIT_LIBRARY}>" rt)
    target_compile_definitions(rubato_asmjit INTERFACE $<BUILD_INTERFACE:RUBATO_ASMJIT> $<BUILD_INTERFACE:ASMJIT_STATIC>)
    target_include_directories(rubato_asmjit SYSTEM INTERFACE $<BUILD_INTERFACE:${ASMJIT_INCLUDE_DIR}>)
  else()
    message(STATUS "Formulas will be interpreted: asmjit (libasmjit-dev) was not found")
  endif()
endif()
install(TARGETS rubato_asmjit EXPORT rubato-targets)

# OpenMP's own library looks at the environment when it is loaded: one that a program has in itself can be told before.
add_library(rubato_openmp INTERFACE)
set_target_properties(rubato_openmp PROPERTIES EXPORT_NAME openmp)
rubato_archives(archives gomp ${OpenMP_CXX_LIBRARIES})
rubato_link(rubato_openmp OPENMP SHARED OpenMP::OpenMP_CXX STATIC ${archives}
  SOURCE "extern \"C\" int omp_get_max_threads(); int main() { return omp_get_max_threads(); }")
install(TARGETS rubato_openmp EXPORT rubato-targets)

find_package(PkgConfig REQUIRED)
pkg_check_modules(FFTW REQUIRED fftw3)   # Debian's FFTW has no CMake config file
add_library(rubato_fftw INTERFACE)
set_target_properties(rubato_fftw PROPERTIES EXPORT_NAME fftw)
rubato_archives(archives fftw3 ${FFTW_LINK_LIBRARIES})
if(archives)
  list(APPEND archives m)
endif()
rubato_link(rubato_fftw FFTW SHARED ${FFTW_LINK_LIBRARIES} STATIC ${archives}
  SOURCE "extern \"C\" void fftw_cleanup(); int main() { fftw_cleanup(); }")
install(TARGETS rubato_fftw EXPORT rubato-targets)

pkg_check_modules(ISAL REQUIRED libisal)   # Debian's ISA-L has no CMake config file
add_library(rubato_isal INTERFACE)
set_target_properties(rubato_isal PROPERTIES EXPORT_NAME isal)
target_link_libraries(rubato_isal INTERFACE ${ISAL_LINK_LIBRARIES})
install(TARGETS rubato_isal EXPORT rubato-targets)

if(RUBATO_MPI)
  find_package(MPI REQUIRED COMPONENTS C)
  add_library(rubato_mpi INTERFACE)
  set_target_properties(rubato_mpi PROPERTIES EXPORT_NAME mpi)
  target_include_directories(rubato_mpi SYSTEM INTERFACE "$<BUILD_INTERFACE:${MPI_C_INCLUDE_DIRS}>")
  target_compile_definitions(rubato_mpi INTERFACE OMPI_SKIP_MPICXX=1 MPICH_SKIP_MPICXX=1)
  target_link_libraries(rubato_mpi INTERFACE ${MPI_C_LIBRARIES})
  install(TARGETS rubato_mpi EXPORT rubato-targets)
endif()

# With MPI the HDF5 that ranks write one file with together, where there is one (Debian: libhdf5-openmpi-dev); a program
# has one HDF5. What was found for the other choice is looked for again.
if(NOT "${RUBATO_HDF5_FOR_MPI}" STREQUAL "${RUBATO_MPI}")
  get_cmake_property(cached CACHE_VARIABLES)
  list(FILTER cached INCLUDE REGEX "^_?HDF5_")
  foreach(variable IN LISTS cached)
    unset(${variable} CACHE)
  endforeach()
endif()
set(RUBATO_HDF5_FOR_MPI ${RUBATO_MPI} CACHE INTERNAL "for which RUBATO_MPI HDF5 was found")
set(HDF5_PREFER_PARALLEL ${RUBATO_MPI})
find_package(HDF5 REQUIRED COMPONENTS C HL)
if(RUBATO_MPI AND NOT HDF5_IS_PARALLEL)
  message(STATUS "Rank 0 will write records: this HDF5 was built without MPI")
endif()
add_library(rubato_hdf5 INTERFACE)
set_target_properties(rubato_hdf5 PROPERTIES EXPORT_NAME hdf5)
target_include_directories(rubato_hdf5 INTERFACE $<BUILD_INTERFACE:${HDF5_INCLUDE_DIRS}>)
# HDF5 may read from the web, and its shared library loads all that takes: thirty libraries.
set(libraries ${HDF5_HL_LIBRARIES} ${HDF5_LIBRARIES})
set(archives)
if(NOT RUBATO_MPI)
  set(names "hdf5|hdf5_hl|z")
  find_library(AEC_ARCHIVE libaec.a)   # what sz is made of
  if(AEC_ARCHIVE)
    string(APPEND names "|sz")
  endif()
  rubato_archives(archives "${names}" ${libraries})
  list(TRANSFORM archives REPLACE "^(.*/libsz\\.a)$" "\\1;${AEC_ARCHIVE}")
endif()
rubato_link(rubato_hdf5 HDF5 SHARED ${libraries} STATIC ${archives} INCLUDES ${HDF5_INCLUDE_DIRS} SOURCE "
    #include <hdf5.h>
    #include <hdf5_hl.h>
    int main() { return H5open() + H5Fclose(H5Fcreate(\"a\", 0, 0, 0)) + H5DSset_scale(H5Dopen2(0, \"a\", 0), \"a\"); }")
if(RUBATO_MPI AND HDF5_IS_PARALLEL)
  target_link_libraries(rubato_hdf5 INTERFACE rubato_mpi)
endif()
install(TARGETS rubato_hdf5 EXPORT rubato-targets)
