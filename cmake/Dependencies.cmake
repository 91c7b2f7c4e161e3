# Every package the product needs, found once. Debian's names are in packages.txt beside this file.
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
    target_link_libraries(rubato_asmjit INTERFACE ${ASMJIT_LIBRARY} rt)
    target_compile_definitions(rubato_asmjit INTERFACE $<BUILD_INTERFACE:RUBATO_ASMJIT> $<BUILD_INTERFACE:ASMJIT_STATIC>)
    target_include_directories(rubato_asmjit SYSTEM INTERFACE $<BUILD_INTERFACE:${ASMJIT_INCLUDE_DIR}>)
  else()
    message(STATUS "Formulas will be interpreted: asmjit (libasmjit-dev) was not found")
  endif()
endif()
install(TARGETS rubato_asmjit EXPORT rubato-targets)

find_package(PkgConfig REQUIRED)
pkg_check_modules(FFTW REQUIRED fftw3)   # Debian's FFTW has no CMake config file
find_library(FFTW_OMP fftw3_omp HINTS ${FFTW_LIBRARY_DIRS} REQUIRED)
add_library(rubato_fftw INTERFACE)
set_target_properties(rubato_fftw PROPERTIES EXPORT_NAME fftw)
target_link_libraries(rubato_fftw INTERFACE ${FFTW_OMP} ${FFTW_LINK_LIBRARIES})
install(TARGETS rubato_fftw EXPORT rubato-targets)

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
# HDF5 may read from the web, and its shared library loads all that takes: thirty libraries, half the time that a short
# run takes. A program has the static one in its place, where there is one, of which it links what it uses: targets with
# RUBATO_OWN_HDF5. Others that link rubato, and may be libraries, have the shared one.
set(libraries ${HDF5_HL_LIBRARIES} ${HDF5_LIBRARIES})
set(own ${libraries})
if(NOT RUBATO_MPI)
  list(TRANSFORM own REPLACE "(/libhdf5[^/]*)\\.so$" "\\1.a")
endif()
if(NOT "${own}" STREQUAL "${libraries}")
  include(CheckCXXSourceCompiles)   # what the static one needs may be missing, or not be named
  set(CMAKE_REQUIRED_INCLUDES ${HDF5_INCLUDE_DIRS})
  set(CMAKE_REQUIRED_LIBRARIES ${own})
  check_cxx_source_compiles("
    #include <hdf5.h>
    #include <hdf5_hl.h>
    int main() { return H5open() + H5Fclose(H5Fcreate(\"a\", 0, 0, 0)) + H5DSset_scale(H5Dopen2(0, \"a\", 0), \"a\"); }"
    RUBATO_HDF5_IS_STATIC)
  unset(CMAKE_REQUIRED_INCLUDES)
  unset(CMAKE_REQUIRED_LIBRARIES)
  if(NOT RUBATO_HDF5_IS_STATIC)
    set(own ${libraries})
  endif()
endif()
set(chosen $<BOOL:$<TARGET_PROPERTY:RUBATO_OWN_HDF5>>)
target_link_libraries(rubato_hdf5 INTERFACE
  "$<BUILD_INTERFACE:$<IF:${chosen},${own},${libraries}>>" "$<INSTALL_INTERFACE:${libraries}>")
target_link_options(rubato_hdf5 INTERFACE "$<BUILD_INTERFACE:$<${chosen}:LINKER:--as-needed>>")
if(RUBATO_MPI AND HDF5_IS_PARALLEL)
  target_link_libraries(rubato_hdf5 INTERFACE rubato_mpi)
endif()
install(TARGETS rubato_hdf5 EXPORT rubato-targets)
