# The version and the compiler that a record names.
configure_file(study/version.cpp.in ${PROJECT_BINARY_DIR}/study/version.cpp @ONLY)
target_sources(rubato_study PRIVATE ${PROJECT_BINARY_DIR}/study/version.cpp)
