# The version and the compiler that a record names.
configure_file(run/version.cpp.in ${PROJECT_BINARY_DIR}/run/version.cpp @ONLY)
target_sources(rubato_run PRIVATE ${PROJECT_BINARY_DIR}/run/version.cpp)
