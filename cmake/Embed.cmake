# Text that is compiled into the library, so that it works wherever the program is installed.

# embed_files(<room> HEADER <header> NAMESPACE <namespace> TYPE <type> FUNCTION <function> [STEMS] FILES …)
# adds to rubato_<room> a source that defines `std::span<const TYPE> FUNCTION()`, a table of (name, text); with STEMS the
# names are without extensions.
function(embed_files room)
  cmake_parse_arguments(PARSE_ARGV 1 arg "STEMS" "HEADER;NAMESPACE;TYPE;FUNCTION" "FILES")
  set(source ${PROJECT_BINARY_DIR}/${room}/embedded.cpp)
  set(script ${PROJECT_SOURCE_DIR}/cmake/EmbedFiles.cmake)
  add_custom_command(OUTPUT ${source}
    COMMAND ${CMAKE_COMMAND} -DOUTPUT=${source} -DHEADER=${arg_HEADER} -DNAMESPACE=${arg_NAMESPACE} -DTYPE=${arg_TYPE}
            -DFUNCTION=${arg_FUNCTION} -DSTEMS=${arg_STEMS} "-DFILES=${arg_FILES}" -P ${script}
    DEPENDS ${arg_FILES} ${script} VERBATIM)
  set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)   # changes with what is embedded
  target_sources(rubato_${room} PRIVATE ${source})
endfunction()

# Every problem file of catalogue/.
file(GLOB catalogue_files CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/catalogue/*.toml)
embed_files(catalogue HEADER rubato/catalogue/catalogue.hpp NAMESPACE rubato::catalogue TYPE Entry FUNCTION entries
  STEMS FILES ${catalogue_files})

# What the page of a report is made of.
file(GLOB page_files CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/report/page/*.* ${PROJECT_SOURCE_DIR}/report/vendor/uplot/uPlot*
  ${PROJECT_SOURCE_DIR}/report/vendor/uplot/LICENSE)
embed_files(report HEADER rubato/report/assets.hpp NAMESPACE rubato::report TYPE Asset FUNCTION assets
  FILES ${page_files})
