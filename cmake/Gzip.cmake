# rubato_gzip(<file>): writes <file>.gz when the project is built, the same bytes from the same file.
find_program(GZIP gzip REQUIRED)
mark_as_advanced(GZIP)
function(rubato_gzip file)
  add_custom_command(OUTPUT ${file}.gz COMMAND ${GZIP} -9nc ${file} > ${file}.gz DEPENDS ${file} VERBATIM)
endfunction()
