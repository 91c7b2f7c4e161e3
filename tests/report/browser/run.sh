#!/usr/bin/env bash
# Opens pages in a headless browser: run.sh all|some MAKE_PAGES FOLDER…, where one of the folders has node_modules/playwright-core.
# Ends with 77 (skipped) where Node, Chromium or playwright-core is missing; `./bootstrap --dev` installs them.
set -euo pipefail
which=$1
make_pages=$2
shift 2

skip() {
  echo "skipped: $*"
  exit 77
}

node=$(command -v node) || skip 'no node'
chromium=$(command -v chromium || command -v chromium-browser) || skip 'no chromium'
playwright=
for folder in "$@"; do
  if [ -d "$folder/node_modules/playwright-core" ]; then
    playwright=$folder
    break
  fi
done
[ -n "$playwright" ] || skip 'no playwright-core'

pages=$(mktemp -d)
trap 'rm -rf "$pages"' EXIT
"$make_pages" "$pages"
"$node" "$(dirname "${BASH_SOURCE[0]}")/check.mjs" "$playwright" "$chromium" "$pages" "$which"
