#!/usr/bin/env bash
# Holds docs/equations.md against the sources: every name in code quotes must be declared in the header named after it,
# and every sentence in double quotes must be the name of a test case. Usage: equations.sh SOURCES [PAGE]
set -euo pipefail
sources=$1
page=${2:-$sources/docs/equations.md}
failures=0
checked=0
fail() { echo "equations.md: $*" >&2; failures=$((failures + 1)); }

# A row's names wait for the header that follows them: `a`, `b` in `room/file.hpp`.
while IFS= read -r row; do
  names=()
  while IFS= read -r name; do
    if [[ $name == */*.hpp ]]; then
      [ -f "$sources/$name" ] || fail "there is no header $name"
      for waiting in ${names[@]+"${names[@]}"}; do
        grep -qE "\b$waiting\b" "$sources/$name" 2>/dev/null || fail "$name does not declare $waiting"
        checked=$((checked + 1))
      done
      names=()
    else
      names+=("$name")
    fi
  done < <(grep -oE '`[^`]+`' <<<"$row" | tr -d '`')
  [ "${#names[@]}" -eq 0 ] || fail "no header after ${names[*]}"
  while IFS= read -r test; do
    grep -rqF "TEST_CASE($test" "$sources/tests" || fail "no test case is called $test"
    checked=$((checked + 1))
  done < <(grep -oE '"[^"]+"' <<<"$row")
done < <(grep -E '^\| ' "$page")

[ "$checked" -gt 0 ] || fail 'nothing was found to check'
[ "$failures" -eq 0 ] && echo "equations.md: $checked names are there"
exit $((failures > 0))
