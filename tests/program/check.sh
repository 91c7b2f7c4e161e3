# What the scripts that test the built program count their failures with; $status, $last and the files out and err are
# those of the run before.
failures=0

# check DESCRIPTION COMMAND…: counts a failure unless the command succeeds.
check() {
  local description=$1
  shift
  if ! "$@"; then
    echo "FAILED: $description"
    echo "  after: ${last:-} (status ${status:-none})"
    echo "  out: $(head -c 600 out 2>/dev/null)"
    echo "  err: $(head -c 600 err 2>/dev/null)"
    failures=$((failures + 1))
  fi
}
