# Writes OUTPUT: a C++ function that returns a table of (name, text) made from FILES. Run with cmake -P and
#   HEADER     the header that declares the function and its entry type, as it is included
#   NAMESPACE  where both live; TYPE and FUNCTION are their names
#   STEMS      whether the names are without extensions
set(body "#include <${HEADER}>\n\nnamespace ${NAMESPACE} {\n\nstd::span<const ${TYPE}> ${FUNCTION}() {\n  static constexpr ${TYPE} table[] = {\n")
set(part NAME)
if(STEMS)
  set(part NAME_WE)
endif()
foreach(file IN LISTS FILES)
  get_filename_component(name ${file} ${part})
  file(READ ${file} text)
  string(APPEND body "    {\"${name}\", R\"__embedded__(${text})__embedded__\"},\n")
endforeach()
string(APPEND body "  };\n  return table;\n}\n\n}  // namespace ${NAMESPACE}\n")
file(WRITE ${OUTPUT} "${body}")
