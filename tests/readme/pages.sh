#!/usr/bin/env bash
# Holds every page, and the help and the messages of the program, against words.txt; and every link against the file and
# the heading that it leads to. Usage: pages.sh RUBATO SOURCES [ANOTHER_PAGE]
set -euo pipefail
rubato=$1
sources=$2
failures=0 links=0
fail() { echo "$*" >&2; failures=$((failures + 1)); }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

"$rubato" --help >"$folder/rubato.md"
for command in $(awk '/^Subcommands:/ { inside = 1; next } /^$/ { inside = 0 } inside { print $1 }' "$folder/rubato.md"); do
  "$rubato" "$command" --help >"$folder/rubato-$command.md"
done
for topic in table problem formulas; do "$rubato" help "$topic" >"$folder/rubato-help-$topic.md"; done
# Messages are text in quotes. Those with "bridge" name a key of earlier problem files, to say what to write now.
for room in base formula grids solve variation ode pde ranks record figures catalogue problem run report program; do
  { grep -rnHE --include='*.[ch]pp' -- '"' "$sources/$room" || true; } | { grep -vE '#include|bridge' || true; } >>"$folder/messages"
done
pages=("$sources"/*.md "$sources"/docs/*.md "$folder"/*.md "${@:3}")

while read -r line; do
  [[ -z $line || $line == \#* ]] && continue
  word=${line%%  *} reason=${line#*  }
  while IFS= read -r found; do
    found=${found#"$sources"/}
    fail "${found#"$folder"/}"$'\n'"  instead of \"$word\": ${reason#"${reason%%[! ]*}"}"
  done < <(grep -nHwE -- "$word" "${pages[@]}")
  while IFS= read -r found; do
    fail "${found#"$sources"/}"$'\n'"  instead of \"$word\": ${reason#"${reason%%[! ]*}"}"
  done < <(grep -E -- "\"[^\"]*\b($word)\b[^\"]*\"" "$folder/messages")
done <"$(dirname "${BASH_SOURCE[0]}")/words.txt"

# The headings of a page as a browser names them: in small letters, without punctuation, with - for spaces.
headings() { sed -nE 's/^#+ //p' "$1" | sed -E 's/[^[:alnum:]_ -]//g; s/ /-/g' | tr '[:upper:]' '[:lower:]'; }

for page in "${pages[@]}"; do
  while IFS= read -r link; do
    links=$((links + 1))
    file=${link%%#*} heading=
    [[ $link == *\#* ]] && heading=${link#*#}
    target=$page
    [ -z "$file" ] || target=$(dirname "$page")/$file
    if [ ! -e "$target" ]; then
      fail "${page#"$sources"/}: $link leads nowhere"
    elif [ -n "$heading" ] && ! headings "$target" | grep -qxF -- "$heading"; then
      fail "${page#"$sources"/}: no heading $link"
    fi
  done < <(awk '/^ *```/ { inside = !inside } !inside' "$page" | grep -oE '\]\([^)]+\)' | sed -E 's/^..//; s/.$//' | grep -vE '^https?:')
done

[ "$links" -gt 0 ] || fail 'no link was found'
[ "$failures" -eq 0 ] && echo "${#pages[@]} pages, $links links"
exit $((failures > 0))
