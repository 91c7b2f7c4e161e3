# Writes OUTPUT: a C++ table of (name, text) from the problem files FILES. Run with cmake -P.
set(body "#include <rubato/catalogue/catalogue.hpp>\n\nnamespace rubato::catalogue {\n\nstd::span<const Entry> entries() {\n  static constexpr Entry table[] = {\n")
foreach(file IN LISTS FILES)
  get_filename_component(name ${file} NAME_WE)
  file(READ ${file} text)
  string(APPEND body "    {\"${name}\", R\"__toml__(${text})__toml__\"},\n")
endforeach()
string(APPEND body "  };\n  return table;\n}\n\n}  // namespace rubato::catalogue\n")
file(WRITE ${OUTPUT} "${body}")
