#!/usr/bin/env bash
# Does what a document says: document.sh RUBATO SOURCE_FOLDER DOCUMENT [PYTHON].
#
# In a folder of its own it runs every `build/rubato …` line of the document's sh blocks, in order. A text block must be
# what the last such line before it prints, but for figures that differ from run to run; one with lines "..." is an
# excerpt, whose other lines must be among those printed. A line with the comment "# exit status N" must end so. A toml
# block that begins with the comment "# NAME.toml" becomes that file. With PYTHON, the python blocks are run as well.
set -euo pipefail
rubato=$1
source_folder=$2
document=$3
python=${4:-}

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/build"
ln -s "$rubato" "$folder/build/rubato"
ln -s "$source_folder/examples" "$folder/examples"
cd "$folder"

# Digits beyond the tenth, figures of the size of rounding and the member that has the largest of these, counts of
# iterations, and times; and how wide columns are, which depends on these. Ranks of schemes follow from times. How many
# numbers are recomputed depends on what a record holds.
varying_figures_masked() {
  sed -E -e 's/(\.[0-9]{10})[0-9]+/\1/g' -e 's/[0-9.]+e-1[0-9]/SMALL/g' -e '/^ *iterations per step/s/[0-9.]+/N/g' -e '/^ *time taken/s/[0-9].*/TIME/' -e 's/(SMALL to SMALL.* in member )[0-9]+/\1N/' -e 's/   +/  /g' -e 's/^[0-9]+( numbers recomputed)/N\1/' \
    -e 's/^ *[0-9]*  (.*[0-9])  [0-9.]+ [a-zµ]+  (good|doubtful|lost)/\1  TIME  \2/'
}

fail() {
  echo "$document: $*"
  exit 1
}

commands=0 compared=0 scripts=0
# run_commands FILE: leaves in `printed` what the last command printed.
run_commands() {
  local line status expected
  : >printed
  while IFS= read -r line; do
    line=${line##*&& }
    line=${line#"${line%%[! ]*}"}
    [[ $line == build/rubato* ]] || continue
    expected=0
    [[ $line =~ \#\ exit\ status\ ([0-9]+) ]] && expected=${BASH_REMATCH[1]}
    status=0
    bash -c "$line" >printed 2>&1 </dev/null || status=$?
    [ "$status" -eq "$expected" ] || fail "status $status of: $line"$'\n'"$(cat printed)"
    commands=$((commands + 1))
  done <"$1"
}

compare() {
  varying_figures_masked <printed >found
  if grep -qx ' *\.\.\.' "$1"; then
    varying_figures_masked <"$1" | grep -vx ' *\.\.\.' >expected
    grep -vxFf found expected && fail 'the command does not print the lines above'
    tr '0-8' '1-9' <expected | grep -qvxFf found || fail 'the comparison compares nothing'
    compared=$((compared + 1))
    return
  fi
  varying_figures_masked <"$1" >expected
  diff -u expected found || fail 'the text block above is not what the command prints'
  # The comparison itself must notice a changed figure.
  tr '0-8' '1-9' <expected | diff -q - found >/dev/null && fail 'the comparison compares nothing'
  compared=$((compared + 1))
}

# One file per fenced block: NUMBER.LANGUAGE, in the order of the document.
awk '/^ *```[a-z]+$/ && !inside { inside = 1; sub(/^ */, ""); name = sprintf("%03d.%s", ++n, substr($0, 4)); printf "" >name; next }
     /^ *```$/ { inside = 0; close(name); next }
     inside { print >name }' "$source_folder/$document"

for block in [0-9][0-9][0-9].*; do
  case $block in
    *.sh) run_commands "$block" ;;
    *.text) compare "$block" ;;
    *.toml)
      read -r _ name <"$block"
      [[ $name == *.toml ]] && cp "$block" "$name"
      ;;
    *.python)
      if [ -n "$python" ]; then
        "$python" "$block" || fail "a python block fails: $(head -3 "$block")"
        scripts=$((scripts + 1))
      fi
      ;;
  esac
done
echo "$document: $commands commands, $compared outputs compared, $scripts scripts"
[ "$commands" -gt 0 ] || fail 'no command found'
[ -z "$python" ] || [ "$scripts" -gt 0 ] || fail 'no python block found'
