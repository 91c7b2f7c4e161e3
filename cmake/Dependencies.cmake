# Every package the product needs, found once. Debian's names are in packages.txt beside this file.
find_package(fmt REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(OpenMP REQUIRED COMPONENTS CXX)
find_package(xtl REQUIRED)   # xsimd's config needs it found first
find_package(xsimd REQUIRED)
find_package(tomlplusplus REQUIRED)
find_package(CLI11 REQUIRED)

find_package(PkgConfig REQUIRED)
pkg_check_modules(FFTW REQUIRED fftw3)   # Debian's FFTW has no CMake config file
find_library(FFTW_OMP fftw3_omp HINTS ${FFTW_LIBRARY_DIRS} REQUIRED)
add_library(rubato_fftw INTERFACE)
set_target_properties(rubato_fftw PROPERTIES EXPORT_NAME fftw)
target_link_libraries(rubato_fftw INTERFACE ${FFTW_OMP} ${FFTW_LINK_LIBRARIES})
install(TARGETS rubato_fftw EXPORT rubato-targets)

set(HDF5_PREFER_PARALLEL FALSE)
find_package(HDF5 REQUIRED COMPONENTS C HL)
add_library(rubato_hdf5 INTERFACE)
set_target_properties(rubato_hdf5 PROPERTIES EXPORT_NAME hdf5)
target_include_directories(rubato_hdf5 INTERFACE $<BUILD_INTERFACE:${HDF5_INCLUDE_DIRS}>)
target_link_libraries(rubato_hdf5 INTERFACE ${HDF5_HL_LIBRARIES} ${HDF5_LIBRARIES})
install(TARGETS rubato_hdf5 EXPORT rubato-targets)
