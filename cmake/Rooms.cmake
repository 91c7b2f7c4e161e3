# A room is one folder of the house and one static library, rubato_<room>, that may link only the rooms it names: what
# a room may know is thus checked by the linker and readable here. Headers are found as <rubato/room/name.hpp>, inside
# the tree through links in the build folder and after installation in the include folder.

set(RUBATO_INCLUDE_DIR ${PROJECT_BINARY_DIR}/include)
file(MAKE_DIRECTORY ${RUBATO_INCLUDE_DIR}/rubato)
file(CREATE_LINK ${PROJECT_SOURCE_DIR}/rubato.hpp ${RUBATO_INCLUDE_DIR}/rubato/rubato.hpp SYMBOLIC)

# rubato_room(<room> [ROOMS <room>...] [PUBLIC <target>...] [PRIVATE <target>...])
function(rubato_room room)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "ROOMS;PUBLIC;PRIVATE")
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${room}/*.cpp)
  file(GLOB headers CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${room}/*.hpp)
  file(CREATE_LINK ${PROJECT_SOURCE_DIR}/${room} ${RUBATO_INCLUDE_DIR}/rubato/${room} SYMBOLIC)
  if(sources)
    add_library(rubato_${room} STATIC ${sources})
    set(scope PUBLIC)
    target_link_libraries(rubato_${room} PRIVATE ${arg_PRIVATE} $<BUILD_INTERFACE:rubato_warnings>)
    rubato_compile_together(rubato_${room})
  else()
    add_library(rubato_${room} INTERFACE)
    set(scope INTERFACE)
  endif()
  set_target_properties(rubato_${room} PROPERTIES EXPORT_NAME ${room} POSITION_INDEPENDENT_CODE ON)
  target_compile_features(rubato_${room} ${scope} cxx_std_20)
  target_include_directories(rubato_${room} ${scope}
    $<BUILD_INTERFACE:${RUBATO_INCLUDE_DIR}> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  list(TRANSFORM arg_ROOMS PREPEND rubato_ OUTPUT_VARIABLE rooms)
  target_link_libraries(rubato_${room} ${scope} ${rooms} ${arg_PUBLIC})
  install(TARGETS rubato_${room} EXPORT rubato-targets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(FILES ${headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/rubato/${room})
endfunction()

# rubato_test_room(<room> [LINK <target>...]): every tests/<room>/*.cpp becomes part of one Catch2 program test_<room>.
# Test cases tagged [long] are left out of the default run; `ctest -C Long -L long` runs them, one test per room.
function(rubato_test_room room)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "LINK")
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/${room}/*.cpp)
  if(NOT sources)
    return()
  endif()
  add_executable(test_${room} ${sources})
  target_link_libraries(test_${room} PRIVATE rubato_test_main ${arg_LINK} rubato_warnings)
  target_include_directories(test_${room} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  target_precompile_headers(test_${room} REUSE_FROM rubato_test_header)
  catch_discover_tests(test_${room} TEST_PREFIX "${room}: " TEST_SPEC "~[long]~[.]" PROPERTIES TIMEOUT 240)
  add_test(NAME "${room}: long" CONFIGURATIONS Long COMMAND test_${room} [long])
  set_tests_properties("${room}: long" PROPERTIES LABELS long TIMEOUT 7200)
endfunction()
