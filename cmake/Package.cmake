# Packages: `cpack -G DEB` writes rubato, librubato-dev and python3-rubato, `cpack -G TGZ` one archive of all of them that
# may be unpacked anywhere. docs/installing.md has the commands.

# The version is that of project(); CITATION.cff repeats it, and has the date.
file(STRINGS ${PROJECT_SOURCE_DIR}/CITATION.cff cited REGEX "^(version|date-released): ")
list(TRANSFORM cited REPLACE "^.*: " "")
list(GET cited 0 cited_version)
list(GET cited 1 release_date)
if(NOT cited_version STREQUAL PROJECT_VERSION)
  message(FATAL_ERROR "CITATION.cff has version ${cited_version}, and the project ${PROJECT_VERSION}")
endif()

set(CPACK_PACKAGE_VENDOR "The Rubato authors")
set(CPACK_PACKAGE_CONTACT "The Rubato authors <rubato@debian.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

# rubato_deb(<component> <package> <section> <description>)
macro(rubato_deb component package section description)
  string(TOUPPER ${component} upper)
  list(APPEND CPACK_COMPONENTS_ALL ${component})
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${package})
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${section})
  set(CPACK_COMPONENT_${upper}_DESCRIPTION "${description}")
  # What Debian wants in every package.
  set(documents ${CMAKE_INSTALL_DATADIR}/doc/${package})
  install(FILES ${PROJECT_BINARY_DIR}/package/copyright ${PROJECT_BINARY_DIR}/package/changelog.gz
    DESTINATION ${documents} COMPONENT ${component})
endmacro()

set(CPACK_COMPONENTS_ALL)
rubato_deb(program rubato science
  "Rubato integrates Hamiltonian systems and multisymplectic equations by\ndiscrete variational principles. It reports how well each conservation law\nholds. A problem is a small text file.")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
# To load shared libraries is a good part of a short run (Dependencies.cmake): HDF5 is in the program, and zlib with it.
file(WRITE ${PROJECT_BINARY_DIR}/package/lintian/rubato "rubato: embedded-library zlib *\n")
install(FILES ${PROJECT_BINARY_DIR}/package/lintian/rubato DESTINATION ${CMAKE_INSTALL_DATADIR}/lintian/overrides
  COMPONENT program)
rubato_deb(dev librubato-dev libdevel
  "Headers, static libraries and the CMake package of Rubato, for C++20 programs.")
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS   # of rubato-config.cmake, and what the static libraries need
  "g++, libeigen3-dev, libfmt-dev, libfftw3-dev, libhdf5-dev, libisal-dev, libtomlplusplus-dev")
if(ASMJIT_LIBRARY)
  string(APPEND CPACK_DEBIAN_DEV_PACKAGE_DEPENDS ", libasmjit-dev")
endif()
if(RUBATO_PYTHON)   # its dependencies: python/CMakeLists.txt
  rubato_deb(python python3-rubato python
    "The package rubato runs problems from Python, with initial data and results\nas NumPy arrays.")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
endif()

file(READ ${PROJECT_SOURCE_DIR}/report/vendor/uplot/LICENSE mit)
string(REGEX REPLACE "\n\n" "\n.\n" mit "${mit}")
string(REGEX REPLACE "\n" "\n " mit "${mit}")
file(WRITE ${PROJECT_BINARY_DIR}/package/copyright "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: rubato

Files: *
Copyright: The Rubato authors
License: GPL-3+
 Rubato is free software, under version 3 of the GNU General Public License or
 a later one. On Debian systems the text of version 3 is in
 /usr/share/common-licenses/GPL-3.

Files: report/vendor/uplot/*
Copyright: Leon Sorokin
License: Expat
 ${mit}
")
execute_process(COMMAND date --utc --rfc-email --date=${release_date} OUTPUT_VARIABLE day OUTPUT_STRIP_TRAILING_WHITESPACE
  COMMAND_ERROR_IS_FATAL ANY)
file(WRITE ${PROJECT_BINARY_DIR}/package/changelog "rubato (${PROJECT_VERSION}) stable; urgency=medium

  * Version ${PROJECT_VERSION}; its capabilities are in CHANGELOG.md.

 -- ${CPACK_PACKAGE_CONTACT}  ${day}
")
rubato_gzip(${PROJECT_BINARY_DIR}/package/changelog)
add_custom_target(package_documents ALL DEPENDS ${PROJECT_BINARY_DIR}/package/changelog.gz)

include(CPack)
