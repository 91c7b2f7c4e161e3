#!/usr/bin/env bash
# The program under mpirun, in a build with MPI: ranks.sh RUBATO SOURCE_FOLDER MPIRUN CASE [KILLS]. Ranks share an
# ensemble or a lattice, and the record is that of one process bit by bit, on every number of ranks, killed and resumed.
set -u
rubato=$1
source_folder=$2
mpirun=$3
case_name=$4
kills=${5:-3}

# Tests may run as root, and on fewer processors than there are ranks.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1
export OMPI_MCA_hwloc_base_binding_policy=none OMP_NUM_THREADS=1 OMP_WAIT_POLICY=passive

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder" || exit 1
source "$source_folder/tests/program/check.sh"

# alone ARGUMENTS…, on RANKS ARGUMENTS…: runs the program; its status, output and messages are then in $status, out, err.
alone() {
  last="rubato $*"
  "$rubato" "$@" >out 2>err </dev/null
  status=$?
}
on() {
  last="mpirun -n $1 rubato ${*:2}"
  timeout 500 "$mpirun" -n "$1" "$rubato" "${@:2}" >out 2>err </dev/null
  status=$?
}

status_is() { check "status $1" test "$status" -eq "$1"; }
# All but the checkpoint, which holds measures of the verdict that shared lattices do not take.
same() {
  local group
  for group in $(h5ls "$1" | awk '$2 == "Group" && $1 != "checkpoint" { print $1 }'); do
    h5diff -d 1e-14 "$1" "$2" "/$group" >difference 2>&1 || return 1
  done
}
differ() { ! same "$@"; }
no() { ! grep -q -- "$1" "$2"; }
once() { test "$(grep -c -- "$1" "$2")" -eq 1; }
levels() { h5ls "$1/levels" | sed -n 's/^t  *Dataset {\([0-9]*\).*/\1/p'; }
members() { h5ls "$1/members" | sed -n 's/^number  *Dataset {\([0-9]*\).*/\1/p'; }

pendulums=("$source_folder/examples/pendulums.toml" --set ensemble.random.count=40)
explicit=(--set scheme.lagrangian=euler-box --set scheme.levels=fixed)
case $case_name in
  lattice)
    ring=(run sine-gordon-2d "${explicit[@]}" --set scheme.until=1 --set output.every=3)
    alone "${ring[@]}" -o alone.h5 --quiet
    for ranks in 2 3; do   # 255 planes
      on $ranks "${ring[@]}" -o shared.h5 --force --json
      status_is 0
      check "one JSON object" once '"steps": 20' out
      check "the record of one process, on $ranks ranks" same alone.h5 shared.h5
    done
    alone check shared.h5
    cp out checked
    for ranks in 2 3; do
      on $ranks check shared.h5
      status_is 0
      check "what one process says of the record, on $ranks ranks" cmp checked out
    done
    # Long rows were written by all ranks together, which datasets made for that show; one process writes what it likes.
    together() { h5dump -p -H -d "$2" "$1" | grep -q 'ALLOC_TIME_EARLY'; }
    if ldd "$rubato" | grep -q 'libhdf5_openmpi\|libhdf5_mpich'; then
      check "rows of fields are for ranks together" together shared.h5 /states/u
    fi
    check "rows of a number are not" eval '! together shared.h5 /levels/t'
    check "nor those of one process" eval '! together alone.h5 /states/u'
    alone "${ring[@]}" --set scheme.until=0.3 -o part.h5 --quiet
    on 3 resume part.h5 --until 1 --quiet
    status_is 0
    check "begun by one process, resumed on three" same alone.h5 part.h5
    on 2 "${ring[@]}" --set scheme.until=0.3 -o part.h5 --force --quiet
    alone resume part.h5 --until 1 --quiet
    status_is 0
    check "begun on two, resumed by one process" same alone.h5 part.h5
    on 2 "${ring[@]}" --set output.compression=1 -o part.h5 --force --quiet
    status_is 0
    check "compressed, by rank 0" h5diff alone.h5 part.h5 /states/u
    check "and not for ranks together" eval '! together part.h5 /states/u'
    rm part.h5
    for undefined in 'sqrt(0.32 - t)' 'sqrt(t - 0.32)'; do   # from some level on, and at the start
      broken=(run sine-gordon-2d "${explicit[@]}" --set scheme.until=1 --set output.every=2 --set laws.every=off
        --set "multisymplectic.S=(v^2 - a^2 - b^2)/2 + 1 - cos(u) + 0.1*u*$undefined")
      alone "${broken[@]}" -o broken.h5 --quiet
      cp err said
      one=$status
      on 3 "${broken[@]}" -o parts.h5 --quiet
      check "what is undefined has the status of one process" test "$one" -eq "$status" -a "$one" -ne 0
      check "and its message" eval 'sed "s/parts.h5/broken.h5/" err | grep -q -x -F -f said'
      if [ -e broken.h5 ]; then
        check "and its record" same broken.h5 parts.h5
      else
        check "and nothing is written" test ! -e parts.h5
      fi
      rm -f broken.h5 parts.h5
    done
    on 2 "${ring[@]}" --set scheme.step=0.0500001 -o other.h5 --quiet
    check "the twin: another step is told apart" differ alone.h5 other.h5
    on 3 "${ring[@]}" --set scheme.until=0.3 -o part.h5 --quiet
    on 2 resume part.h5 --until 1 --quiet
    status_is 0
    check "resumed on another number of ranks" same alone.h5 part.h5
    # Tangent solutions, events, output between levels, an S of x and t, a start from a record.
    told=(run sine-gordon-2d "${explicit[@]}" --tangents --set grid.x.cells=61 --set grid.y.cells=51 --set scheme.until=1
      --set output.every=3 --set output.interval=0.13 --set 'output.quantities.mean=integral(u*v)'
      --set 'output.quantities.here={ formula = "dy(u)", at = { x = 1.2, y = 0.7 } }'
      --set 'events.grows={ crossing = "integral(v^2) > 1", quantities = ["integral(u)"] }'
      --set 'multisymplectic.S=(v^2 - a^2 - b^2)/2 + (1 + 0.1*cos(pi*x/14))*(1 - cos(u)) + 0.1*u*sin(t)')
    alone "${told[@]}" -o alone.h5 --force --quiet
    status_is 0
    on 3 "${told[@]}" -o shared.h5 --force --quiet
    status_is 0
    check "what is told beside levels and laws, as of one process" same alone.h5 shared.h5
    on 2 "${told[@]}" --set scheme.until=0.4 -o part.h5 --force --quiet
    on 3 resume part.h5 --until 1 --quiet
    check "resumed on another number of ranks" same alone.h5 part.h5
    sed '/^\[initial\]/,/^$/d' "$source_folder/catalogue/sine-gordon-2d.toml" >from.toml
    printf '\n[initial]\nfrom = "alone.h5"\n' >>from.toml
    begun=(run from.toml "${explicit[@]}" --set grid.x.cells=61 --set grid.y.cells=51 --set scheme.until=2)
    alone "${begun[@]}" -o begun.h5 --quiet
    status_is 0
    on 3 "${begun[@]}" -o shared.h5 --force --quiet
    status_is 0
    check "begun from a record that rank 0 reads" same begun.h5 shared.h5
    # leapfrog, and with variable levels.
    for levels in fixed variable; do
      ring=(run sine-gordon-2d --set scheme.lagrangian=leapfrog --set scheme.levels=$levels --set scheme.until=0.5 --set output.every=3)
      alone "${ring[@]}" -o alone.h5 --force --quiet
      for ranks in 2 4; do
        on $ranks "${ring[@]}" -o shared.h5 --force --quiet
        status_is 0
        check "the record of one process, on $ranks ranks" same alone.h5 shared.h5
      done
      on 4 "${ring[@]}" --set scheme.until=0.2 -o part.h5 --force --quiet
      on 3 resume part.h5 --until 0.5 --quiet
      status_is 0
      check "resumed on another number of ranks" same alone.h5 part.h5
    done
    # The box scheme on a line.
    for levels in fixed variable; do
      line=(run kdv --set grid.x.cells=1001 --set scheme.levels=$levels --set scheme.until=0.2 --set output.every=7)
      alone "${line[@]}" -o alone.h5 --force --quiet
      alone check alone.h5
      cp out checked
      for ranks in 2 3 4; do
        on $ranks "${line[@]}" -o shared.h5 --force --quiet
        status_is 0
        check "the record of one process, on $ranks ranks" same alone.h5 shared.h5
      done
      on 3 check alone.h5
      status_is 0
      check "what one process says of the record" cmp checked out
      on 4 "${line[@]}" --set scheme.until=0.1 -o part.h5 --force --quiet
      on 3 resume part.h5 --until 0.2 --quiet
      status_is 0
      check "resumed on another number of ranks" same alone.h5 part.h5
    done
    on 2 "${line[@]}" --set scheme.step=0.0050001 -o other.h5 --force --quiet
    check "the twin: another step is told apart" differ alone.h5 other.h5
    on 4 run kdv --set grid.x.cells=49 -o never.h5 --quiet
    status_is 2
    check "one rank says how many can share so few cells" once 'kdv.toml.*4 ranks cannot share.*start 3' err
    check "and nothing is written" test ! -e never.h5
    # Transforms round as the number of ranks has it.
    splitting=(--set scheme.lagrangian=splitting --set grid.x.cells=135 --set grid.y.cells=121)
    collocation=(--set scheme.lagrangian=fourier --set scheme.stages=2 --set grid.x.cells=75 --set grid.y.cells=64)
    for scheme in differences fourier collocation; do
      settings=("${splitting[@]}" --set scheme.space=$scheme)
      [ $scheme != collocation ] || settings=("${collocation[@]}")
      ring=(run sine-gordon-2d "${settings[@]}" --set scheme.levels=fixed --set scheme.until=0.5)
      alone "${ring[@]}" -o alone.h5 --force --quiet
      for ranks in 2 3; do
        on $ranks "${ring[@]}" -o shared.h5 --force --quiet
        status_is 0
        check "the fields of one process to rounding, $scheme, on $ranks ranks" h5diff -d 1e-12 alone.h5 shared.h5 /states/u /states/u
        check "the twin: which is not all of their bits" differ alone.h5 shared.h5
      done
      on 3 check shared.h5
      status_is 0
      on 3 "${ring[@]}" --set scheme.until=0.2 -o part.h5 --force --quiet
      on 3 resume part.h5 --until 0.5 --quiet
      status_is 0
      check "resumed on as many ranks" same shared.h5 part.h5
    done
    # The disk of the rank that writes is full, here: no file may be so long there.
    ring=(run sine-gordon-2d "${explicit[@]}" --set scheme.until=0.2 --set output.every=1 --set laws.fields=true)
    "$rubato" "${ring[@]}" --set scheme.until=0.1 -o full.h5 --quiet
    cp full.h5 before.h5
    cat >limited <<'LIMITED'
[ "${OMPI_COMM_WORLD_RANK:-$PMI_RANK}" -ne 0 ] || ulimit -f "$1"
shift
exec "$@"
LIMITED
    for limit in 8000 20000 200000; do   # a copy, some rows more; the twin has room
      last="mpirun -n 3 rubato resume, with files of $limit KB at most"
      timeout 500 "$mpirun" -n 3 bash limited $limit "$rubato" resume full.h5 --until 0.2 --quiet >out 2>err </dev/null
      status=$?
      if [ $limit -lt 200000 ]; then
        status_is 5
        check "one rank names the place" once '^rubato: error: .*full.h5: .*File too large' err
        check "the record is what it was" cmp full.h5 before.h5
      else
        status_is 0
        alone "${ring[@]}" -o alone.h5 --force --quiet
        check "and is continued where there is room" same alone.h5 full.h5
      fi
    done
    # The same where ranks write together: the library lets one of a machine, here rank 0, write for the others.
    on 3 "${ring[@]}" --set scheme.until=0.1 -o full.h5 --force --quiet
    cp full.h5 before.h5
    last="mpirun -n 3 rubato resume, of what ranks write together, with files of 20000 KB at most"
    timeout 500 "$mpirun" -n 3 bash limited 20000 "$rubato" resume full.h5 --until 0.2 --quiet >out 2>err </dev/null
    status=$?
    status_is 5
    check "one rank names the place" once '^rubato: error: .*full.h5: .*File too large' err
    check "the record is what it was" cmp full.h5 before.h5
    on 3 resume full.h5 --until 0.2 --quiet
    status_is 0
    check "and it is continued" same alone.h5 full.h5
    ;;
  lattice_killed)
    # Killed, and continued on another number of ranks.
    # Rows of fields are long enough to be written by all ranks together. A run of 1e6 steps outlasts all kills, and its
    # record fits on any disk (one that does not is refused beforehand).
    ring=(run sine-gordon-2d "${explicit[@]}" --set grid.x.cells=135 --set grid.y.cells=125 --set output.every=50 --set scheme.until=5e4)
    grown=0 before=0
    for ((kill = 0; kill < kills; ++kill)); do
      command=(resume killed.h5)
      [ -e killed.h5 ] || command=("${ring[@]}" -o killed.h5)
      "$mpirun" -n 4 "$rubato" "${command[@]}" --quiet >out 2>err </dev/null &
      launcher=$!
      last="mpirun -n 4 rubato ${command[*]}, of which a rank was killed"
      for ((wait = 0; wait < 6000; ++wait)); do
        [ -e "/proc/$launcher" ] || break
        read -r -a pids <"/proc/$launcher/task/$launcher/children"
        [ "${#pids[@]}" -lt 4 ] || break
        sleep 0.05
      done
      # The first of these only when there are levels to be kept, however slow the machine is.
      for ((wait = 0; kill == 0 && wait < 6000; ++wait)); do
        [ "$(levels killed.h5 2>/dev/null)" -gt 1 ] 2>/dev/null && break
        sleep 0.05
      done
      sleep "$((RANDOM % 5)).$((RANDOM % 10))"   # versions are committed every two seconds
      kill -KILL "${pids[RANDOM % ${#pids[@]}]}" 2>/dev/null
      for ((wait = 0; wait < 3000; ++wait)); do
        kill -0 "$launcher" 2>/dev/null || break
        sleep 0.1
      done
      hung=no
      if kill -0 "$launcher" 2>/dev/null; then  # it may miss the death of a rank that it is just starting
        hung=yes
        kill -KILL "${pids[@]}" "$launcher" 2>/dev/null
      fi
      wait $launcher
      status=$?
      check "a run of which a rank died has not ended well" test "$status" -ne 0
      [ "$hung" = yes ] || check "and the launcher says so" grep -q 'signal 9' err
      [ -e killed.h5 ] || continue
      check "an ordinary reader opens the record" h5ls killed.h5 >/dev/null
      now=$(levels killed.h5)
      check "no level is lost: $before, and then $now" test "${now:-0}" -ge "$before"
      [ "${now:-0}" -le "$before" ] || grown=$((grown + 1))
      before=${now:-0}
    done
    check "kills after which the record has more levels" test "$grown" -gt 0
    until=$(awk "BEGIN { print 0.05 * 50 * ($before + 5) }")   # a row of levels is of 50 steps
    on 2 resume killed.h5 --until "$until" --quiet
    status_is 0
    alone "${ring[@]}" --set scheme.until="$until" -o never-killed.h5 --quiet
    check "the record is that of a run never stopped" same never-killed.h5 killed.h5
    echo "$kill kills, $grown after new levels; $before levels"
    ;;
  shared)
    alone run "${pendulums[@]}" -o alone.h5 --json
    status_is 0
    for ranks in 1 2 3; do
      on $ranks run "${pendulums[@]}" -o shared.h5 --force --json
      status_is 0
      check "one JSON object, of one rank" once '"members": 40' out
      check "the record of one process, on $ranks ranks" same alone.h5 shared.h5
    done
    alone run "${pendulums[@]}" --set ensemble.random.count=3 -o three.h5 --quiet
    on 5 run "${pendulums[@]}" --set ensemble.random.count=3 -o few.h5 --quiet
    status_is 0
    check "with more ranks than members" same three.h5 few.h5
    on 2 run "${pendulums[@]}" --set ensemble.random.seed=2 -o other.h5 --quiet
    check "the twin: other members are told apart" differ alone.h5 other.h5
    on 3 check shared.h5
    status_is 0
    check "says that all agree" once 'all agree' out
    on 3 scan pendulum initial.p=0.5:1.5:5 --set scheme.until=20 -o scan.h5
    status_is 0
    alone scan pendulum initial.p=0.5:1.5:5 --set scheme.until=20 -o scan-alone.h5
    check "a scan as well" same scan-alone.h5 scan.h5
    on 3 run "${pendulums[@]}" --set scheme.max_steps=450 -o short.h5
    status_is 4
    check "members that fail are told once" once 'members ended early' err
    ;;
  refused)
    for problem in pendulum sine-gordon; do
      stages=$([ $problem = pendulum ] || echo '--set scheme.stages=2')
      on 2 run $problem $stages -o never.h5
      status_is 2
      check "one rank says so" once '^rubato: error: ' err
      check "the place" grep -q "^rubato: error: $problem.toml (built-in):[0-9]*:[0-9]*: \|^rubato: error: .*--set" err
      check "and what to do" grep -q '2 ranks cannot share this run: .*without mpirun' err
    done
    for method in '"euler-box"' '"leapfrog"' '"box" with one stage'; do   # whatever else is
      check "what is shared, $method" grep -q "a line is shared with lagrangian = .*$method" err
    done
    check "the twin: what is not, is not told" no '"splitting"' err
    on 4 run sine-gordon-2d "${explicit[@]}" --set grid.y.cells=3 -o never.h5
    status_is 2
    check "more ranks than planes" once '4 ranks cannot share a lattice of 3 planes across y' err
    on 2 converge pendulum
    status_is 2
    check "nothing was written" test -z "$(ls ./*.h5 2>/dev/null)"
    alone run pendulum --set scheme.until=5 -o one.h5 --quiet
    on 2 resume one.h5 --until 10
    status_is 2
    on 3 run "${pendulums[@]}" --set scheme.stepp=1 -o never.h5
    status_is 2
    check "one rank says what is wrong" once '^rubato: error: ' err
    on 3 frobnicate
    status_is 2
    check "one rank says so" once '^rubato: error: ' err
    # What is for one process is done by one.
    on 3 list
    status_is 0
    check "one list" once 'Pendulum, librating' out
    on 2 check one.h5
    status_is 0
    check "one table" once '^Pendulum, librating' out
    on 2 run "${pendulums[@]}" -o missing/folder/never.h5
    status_is 5
    check "one rank says so" once '^rubato: error: ' err
    ;;
  killed)
    all=150   # of a tenth of a second each
    pendulums=("$source_folder/examples/pendulums.toml" --set ensemble.random.count=$all --set scheme.until=2500)
    alone run "${pendulums[@]}" -o alone.h5 --quiet
    said=0 grown=0 before=0
    for ((kill = 0; kill < kills; ++kill)); do
      command=(resume killed.h5)
      [ -e killed.h5 ] || command=(run "${pendulums[@]}" -o killed.h5)
      ranks=4
      "$mpirun" -n $ranks "$rubato" "${command[@]}" --quiet >out 2>err </dev/null &
      launcher=$!
      last="mpirun -n $ranks rubato ${command[*]}, of which a rank was killed"
      # Some time after the ranks are there; then one of them, the first as well.
      for ((wait = 0; wait < 6000; ++wait)); do
        [ -e "/proc/$launcher" ] || break
        read -r -a pids <"/proc/$launcher/task/$launcher/children"
        [ "${#pids[@]}" -lt "$ranks" ] || break
        sleep 0.05
      done
      # The first of these only when there are members to be kept, however slow the machine is.
      for ((wait = 0; kill == 0 && wait < 6000; ++wait)); do
        [ ! -e killed.h5 ] || [ "$(members killed.h5)" -eq 0 ] || break
        sleep 0.05
      done
      sleep "0.$((RANDOM % 10))$((RANDOM % 10))"
      kill -KILL "${pids[RANDOM % ${#pids[@]}]}" 2>/dev/null
      wait $launcher
      status=$?
      [ -e killed.h5 ] || continue
      check "an ordinary reader opens the record" h5ls killed.h5 >/dev/null
      now=$(members killed.h5)
      check "no member is lost: $before, and then $now" test "${now:-0}" -ge "$before"
      [ "${now:-0}" -le "$before" ] || grown=$((grown + 1))
      before=${now:-0}
      [ "$before" -lt $all ] || break
      check "a run of which a rank died has not ended well" test "$status" -ne 0
      check "and says so" grep -q 'interrupted after\|signal 9' err
      ! grep -q "rubato: error: interrupted after .* of $all members; continue with" err || said=$((said + 1))
    done
    check "kills after which the record has more members" test "$grown" -gt 0
    echo "$kill kills, $grown after new members, $said told by the first rank; $before members"
    on 2 resume killed.h5 --quiet
    status_is 0
    check "the record is that of a run never stopped" same alone.h5 killed.h5
    # The launcher is asked to end: so are the ranks. Again, if they came to the end of all members before.
    for ((attempt = 0, status = 0; status == 0 && attempt < 10; ++attempt)); do
      rm -f ended.h5
      "$mpirun" -n 3 "$rubato" run "${pendulums[@]}" -o ended.h5 --quiet >out 2>err </dev/null &
      launcher=$!
      last='mpirun -n 3 rubato run, ended'
      for ((wait = 0; wait < 6000; ++wait)); do
        [ ! -e ended.h5 ] || break
        sleep 0.05
      done
      kill -TERM $launcher
      wait $launcher
      status=$?
    done
    check "interrupted" test "$status" -ne 0
    check "a record" test -s ended.h5
    on 4 resume ended.h5 --quiet
    status_is 0
    check "and continued" same alone.h5 ended.h5
    ;;
  *)
    echo "no case $case_name"
    exit 2
    ;;
esac
[ "$failures" -eq 0 ] && echo "$case_name: as expected"
exit $((failures > 0))
