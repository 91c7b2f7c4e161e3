#!/usr/bin/env bash
# not_fused.sh PROGRAM COMPILER: fails if the program has an instruction that multiplies and adds with one rounding. Its
# code for wide vectors would then give other bits than its code for narrow ones. Only for x86-64 (77: skipped).
set -euo pipefail
program=$1
compiler=$2
[ "$(uname -m)" = x86_64 ] || exit 77

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
fused() {
  objdump -d --no-show-raw-insn "$1" >"$folder/code" || exit 2
  grep -cE '\<vfn?m(add|sub)[0-9a-z]*' "$folder/code" || true
}
echo 'double f(double a, double b, double c) { return a * b + c; }' >"$folder/twin.cpp"
"$compiler" -O2 -mfma -ffp-contract=fast -c "$folder/twin.cpp" -o "$folder/twin.o"
[ "$(fused "$folder/twin.o")" -gt 0 ] || { echo 'a fused instruction is not recognised'; exit 1; }

count=$(fused "$program")
echo "$count fused instructions"
[ "$count" -eq 0 ]
