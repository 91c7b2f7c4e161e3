# Embeds every problem file of catalogue/ into the library, so that it works wherever the program is installed.
file(GLOB catalogue_files CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/catalogue/*.toml)
set(catalogue_source ${PROJECT_BINARY_DIR}/catalogue/embedded.cpp)
add_custom_command(OUTPUT ${catalogue_source}
  COMMAND ${CMAKE_COMMAND} -DOUTPUT=${catalogue_source} "-DFILES=${catalogue_files}"
          -P ${PROJECT_SOURCE_DIR}/cmake/EmbedCatalogue.cmake
  DEPENDS ${catalogue_files} ${PROJECT_SOURCE_DIR}/cmake/EmbedCatalogue.cmake VERBATIM)
target_sources(rubato_catalogue PRIVATE ${catalogue_source})
