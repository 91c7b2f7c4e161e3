#!/usr/bin/env bash
# Tests of the built program: program.sh RUBATO SOURCE_FOLDER CASE. Every check names what it expects, and `expect` itself
# is tried on a false expectation first, so that a script that checks nothing cannot pass.
set -u
rubato=$1
source_folder=$2
case_name=$3

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder" || exit 1
source "$source_folder/tests/program/check.sh"

# run ARGUMENTS…: runs the program; its status, output and messages are then in $status, out and err.
run() {
  "$rubato" "$@" >out 2>err </dev/null
  status=$?
  last="rubato $*"
}

# expect STATUS [TEXT]: the status, and a text on standard error (for status 0: on standard output).
expect() {
  check "status $1" test "$status" -eq "$1"
  if [ "$1" -eq 0 ]; then
    [ $# -lt 2 ] || check "prints: $2" grep -qF -- "$2" out
  else
    [ $# -lt 2 ] || check "says: $2" grep -qF -- "$2" err
    check "begins with rubato: error:" grep -q '^rubato: error: ' err
  fi
}

nothing_written() { check "writes no record" test -z "$(find . -name '*.h5*')"; }

json() { # json KEY: one number of the JSON object in `out`
  grep -o "\"$1\": *[-+0-9.eE]*" out | head -1 | sed 's/.*: *//'
}

# A wave of long life on a small lattice: linear but for terms that only take time.
write_lattice() {
  local S="(v^2 - w^2)/2 + u^2/2"
  for k in $(seq 2 120); do S="$S + 1e-7*cos($k*u + $k)/$k^4"; done
  cat >lattice.toml <<END
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "$S"
[grid]
x = { from = 0, to = "2*pi", cells = 31 }
[initial]
u = "sin(x)"
v = "-sqrt(2)*cos(x)"
[exact]
u = "sin(x - sqrt(2)*t)"
[invariants]
area = "u"
[scheme]
step = 0.1
until = 1e9
END
}

# The version of a record: a commit replaces the file by another.
version() { stat -c '%i %y %s' "$1" 2>/dev/null; }

# wait_for_version FILE VERSION: until the record is there and of another version, at most five minutes.
wait_for_version() {
  for _ in $(seq 6000); do
    [ -s "$1" ] && [ "$(version "$1")" != "$2" ] && return
    sleep 0.05
  done
  check "a new version of $1 within five minutes" false
}

# wait_for_levels FILE: until the record has more than its first level, which is a version of its own.
wait_for_levels() {
  wait_for_version "$1" ''
  wait_for_version "$1" "$(version "$1")"
}

write_problem() {
  cat >problem.toml <<'END'
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 - cos(q)"
[initial]
q = 0
p = 1.9
[scheme]
step = 0.1
until = 10
END
}

# The checks themselves: a false expectation has to be counted.
run --version
expect 2 "no such text" >/dev/null
if [ "$failures" -lt 2 ]; then
  echo "the checks check nothing"
  exit 1
fi
failures=0

case $case_name in
  catalogue)
    run list
    expect 0 kepler
    for name in $(grep -oE '^  [a-z0-9-]+' out); do
      run show "$name"
      expect 0 '[scheme]'
      cmp -s out "$source_folder/catalogue/$name.toml" || check "show prints the file $name.toml" false
    done
    run show keppler
    expect 2 'did you mean "kepler"?'
    "$rubato" list >/dev/full 2>err
    status=$?
    expect 5 'cannot be written'
    ;;
  libraries)
    # What lies in the folder that the program is started in is no library of its, whatever its name. The twin: the same
    # folder, where the loader is told of it.
    names=$(ldd "$rubato" | awk '$2 == "=>" && $3 ~ /^\// { print $1 }')
    check 'has libraries' test -n "$names"
    for name in $names; do echo 'not a library' >"$name"; done
    run --version
    expect 0 'rubato '
    LD_LIBRARY_PATH=$folder "$rubato" --version >/dev/null 2>&1
    check 'such libraries would be noticed' test $? -ne 0
    ;;
  waiting)
    # Waiting threads sleep, unless the environment says otherwise. A program with OpenMP in itself sets that before OpenMP
    # reads it.
    unset OMP_WAIT_POLICY GOMP_SPINCOUNT
    policy() {
      OMP_DISPLAY_ENV=true "$rubato" list 2>&1 >/dev/null | sed -n "s/.*OMP_WAIT_POLICY = '\([^']*\)'.*/\1/p"
    }
    ldd "$rubato" | grep -q libgomp || check 'threads sleep' test "$(policy)" = PASSIVE
    check 'the environment decides' test "$(OMP_WAIT_POLICY=active policy)" = ACTIVE
    ;;
  usage)
    run --help
    expect 0 'Examples:'
    run run --help
    expect 0 '--set'
    run --version
    expect 0 'rubato '
    run
    expect 2
    run rnu pendulum
    expect 2 'did you mean run?'
    run run
    expect 2 'problem is required'
    run run pendulum --jsn
    expect 2 '--jsn'
    run run pendulum --set scheme.step=0.1 scheme.until=1
    expect 2 'write --set before each setting'
    run run pendulum --threads none
    expect 2 'number of threads'
    run resume a.h5 --until nan
    expect 2 'not a finite number'
    run run ''
    expect 2 'the name is empty'
    run run pendulum -o ''
    expect 2 'the name is empty'
    run check ''
    expect 2 'the name is empty'
    nothing_written
    NO_COLOR=1 run rnu
    check "no colour codes" bash -c '! grep -q $'"'"'\x1b'"'"' err'
    ;;
  bad_input)
    write_problem
    sed 's/cos(q)/coss(q)/' problem.toml >bad.toml
    run run bad.toml
    expect 2 'bad.toml:4:14: '
    check "a suggestion" grep -q "did you mean 'cos'" err
    check "a caret" grep -q '^ *^$' err
    sed 's/step =/stpe =/' problem.toml >bad.toml
    run run bad.toml --json
    expect 2 'bad.toml:9:1: unknown key stpe in [scheme]; did you mean step?'
    check "no JSON for status 2" test ! -s out
    : >empty.toml
    run run empty.toml
    expect 2 'the file is empty'
    head -c 10000000 /dev/zero | tr '\0' 'x' >long.toml
    run run long.toml
    expect 2 'the limit is'
    { printf 'a = '; head -c 100000 /dev/zero | tr '\0' '['; } >deep.toml
    run run deep.toml
    expect 2 'nested deeper'
    head -c 4096 /dev/urandom >junk.toml
    run run junk.toml
    expect 2 'junk.toml:'
    mkdir folder
    run run folder
    expect 2 'this is a folder'
    run run missing.toml
    expect 2 'there is no such file'
    run run /proc/self/mem # exists, and reading it fails
    expect 5 'cannot be read'
    run run problem.toml --set scheme.step=0
    expect 2 '--set scheme.step=0: step = 0 leads nowhere'
    run run problem.toml --set scheme.stpe=1
    expect 2 '--set scheme.stpe=1: unknown key stpe'
    nothing_written
    ;;
  settings)
    run run pendulum --set scheme.until=1 --set scheme.levels=fixed -o a.h5 --json
    expect 0 '"steps"'
    check "ten steps of 0.1" test "$(json steps)" -eq 10
    run run --set scheme.until=1 --set scheme.step=0.05 --set scheme.levels=fixed pendulum -o b.h5 --json
    expect 0
    check "twenty steps of 0.05" test "$(json steps)" -eq 20
    ;;
  run)
    write_problem
    run run problem.toml
    expect 0 steps
    check "writes the file of the problem's name" test -s problem.h5
    cp problem.h5 before.h5
    run run problem.toml
    expect 2 --force
    check "leaves the record alone" cmp -s problem.h5 before.h5
    run run problem.toml --force --json
    expect 0 discrete_energy
    check "one JSON object" test "$(grep -c '^{' out)" -eq 1
    run run problem.toml --force --quiet
    expect 0
    check "quiet prints nothing" test ! -s out -a ! -s err
    run run problem.toml -o missing/folder/a.h5
    expect 5 missing/folder
    cp problem.toml copy.toml
    run run copy.toml --force -o ./copy.toml
    expect 2 'would replace the file that is read'
    check "leaves the problem alone" cmp -s copy.toml problem.toml
    "$rubato" run problem.toml --force >&- 2>&-
    status=$?
    last='rubato run with closed standard streams'
    check "status 5" test "$status" -eq 5
    run check problem.h5
    expect 0 steps
    (ulimit -f 20 && exec "$rubato" run pendulum --set scheme.until=1e5 -o limited.h5 --quiet) >out 2>err
    status=$?
    last='rubato run with a limit on the size of files'
    expect 5 'limited.h5: '
    check "leaves nothing of it" test ! -e limited.h5.partial
    run run kepler --set parameters.e=0.85 --set scheme.on_singular=stop -o singular.h5 --json
    expect 3 'h ='
    check "JSON for status 3" grep -q '"status": *3' out
    check "the record up to there" test -s singular.h5
    ;;
  resume)
    run run pendulum --set scheme.until=5 -o part.h5 --quiet
    expect 0
    run resume part.h5 --until 10 --json
    expect 0 '"steps"'
    steps=$(json steps)
    run run pendulum --set scheme.until=10 -o whole.h5 --json
    check "as many steps as in one run" test "$(json steps)" -eq "$steps"
    run check part.h5 --json
    expect 0 max_relative_deviation
    check "check sees the same steps" test "$(json steps)" -eq "$steps"
    run resume missing.h5
    check "status 2 or 5" test "$status" -eq 2 -o "$status" -eq 5
    ;;
  events)
    run run kepler --set scheme.until=20 --set 'events.apsis=x*u+y*v' --set 'events.stop=t>15' -o a.h5 --json
    expect 0 '"stopped": {"event": "stop", "t": 15'
    check "crossings are counted" grep -q '"apsis": {"count": [2-9], "first": ' out
    run check a.h5
    expect 0 'ended by'
    run resume a.h5 --until 30
    expect 0 'ended by'
    check "and that nothing was added" grep -q 'event stop ended the run' err
    run export a.h5
    expect 0 events_apsis.csv
    run run kepler --set 'events.stop=x>=1' -o never.h5
    expect 2 'write > or <'
    run run henon-heiles-section --set scheme.until=50 -o s.h5
    expect 0 'event section'
    run report s.h5
    expect 0
    check "the section is on the page" grep -q '"sections":\[{"name":"section"' s.html
    run converge kepler --set scheme.until=2 --set 'events.stop=t>1'
    expect 0
    ;;
  ensemble)
    run scan pendulum initial.p=0.5:1.5:3 scheme.levels=variable,fixed --set scheme.until=20
    expect 0 'initial.p'
    check "a line for each member" test "$(grep -c '"variable"\|"fixed"' out)" -eq 6
    check "a record" test -s pendulum-scan.h5
    run scan pendulum initial.p=0.5:1.5:3 --set scheme.until=20
    expect 2 --force
    run scan pendulum initial.p=0.5:1.5:3 --set scheme.until=20 -o all.h5 --json
    expect 0 '"members": 3'
    check "figures over members" grep -q '"max_relative_deviation": {"min": .*"worst": ' out
    run check all.h5
    expect 0 "all agree"
    run resume all.h5
    expect 0
    run resume all.h5 --until 30
    expect 2 "leave it out"
    run export all.h5
    expect 0 members.csv
    run report all.h5
    expect 0 all.html
    check "the page is that of an ensemble" grep -q '"kind":"ensemble"' all.html
    run report all.h5 --max-size 0.01
    expect 2 "this record needs at least"
    run compare all.h5 all.h5
    expect 0 "the same in all"
    run scan pendulum initial.p=0.5:1.5:3 --set scheme.until=20 --set scheme.step=0.05 -o finer.h5
    expect 0
    run compare all.h5 finer.h5
    expect 0 "member by member, 3 given the same in both"
    check "where they are farthest apart" grep -q "last level .*farthest apart in member [0-2]: " out
    check "where the problems differ" grep -q "step = 0.05" out
    run compare all.h5 finer.h5 --json
    expect 0 '"members_alike": 3'
    run scan pendulum initial.p=0.6:1.6:3 --set scheme.until=20 -o others.h5
    run compare all.h5 others.h5
    expect 0 "no member was given the same"
    run compare all.h5 finer.h5 -o both.html
    expect 2 "leave it out"
    run run pendulum --set scheme.until=20 -o single.h5
    run compare all.h5 single.h5
    expect 2 "is the record of an ensemble"
    run scan pendulum initial.u=0:1:2 -o never.h5
    expect 2 "unknown key u"
    run scan pendulum p=0:1:2 -o never.h5
    expect 2 "table.key=from:to:count"
    run scan pendulum initial.p -o never.h5
    expect 2
    run scan pendulum initial.p=0:1 -o never.h5
    expect 2 "from:to:count"
    run scan pendulum scheme.max_steps=5,1000 -o some.h5 --json
    expect 4 "1 of 2 members ended early"
    check "and says so in JSON" grep -q '"ended_early": 1' out
    check "nothing was written for wrong input" test ! -e never.h5
    ;;
  converge)
    run converge pendulum --set scheme.until=5 --tolerance 1e-6
    expect 0 "order 1.9"
    run converge pendulum --set scheme.until=5 --json
    expect 0 '"quantities"'
    check "an order" awk "BEGIN { exit !($(json order) > 1.8 && $(json order) < 2.2) }"
    run converge pendulum --tolerance 0
    expect 2 "above 0"
    run converge pendulum --set scheme.step=auto --set scheme.energy_tolerance=1e-3
    expect 2 "give it as a number"
    run converge missing
    expect 2
    check "no record" test -z "$(ls ./*.h5 2>/dev/null)"
    ;;
  advise)
    run advise pendulum --set scheme.until=5 --tolerance 1e-4
    expect 0 'splitting, composition = '
    check "at least three with a cost" grep -q '^   3 ' out
    sed -n '/^  1, in/,/^  2, in/s/^    //p' out >first.toml
    check "the lines are TOML for [scheme]" grep -q '^step = ' first.toml
    run show pendulum --unset scheme
    { cat out; echo '[scheme]'; cat first.toml; echo 'until = 5'; } >mine.toml
    run converge mine.toml --json
    expect 0 '"verdict": "good"'
    rm -f first.toml mine.toml
    run advise pendulum --set scheme.until=5 --json
    expect 0 '"schemes"'
    check "no table beside it" test "$(grep -c 'in \[scheme\]' out)" -eq 0
    run advise pendulum --tolerance 0
    expect 2 "above 0"
    run advise pendulum --set scheme.step=auto --set scheme.energy_tolerance=1e-3
    expect 2 "give it as a number"
    run advise missing
    expect 2
    nothing_written
    ;;
  report)
    run run pendulum --set scheme.until=5 -o a.h5 --quiet
    run run pendulum --set scheme.until=5 --set scheme.levels=fixed -o b.h5 --quiet
    run report a.h5
    expect 0 a.html
    check "a page" grep -q '^<!DOCTYPE html>' a.html
    run report a.h5
    expect 0
    echo mine >mine.html
    run report a.h5 -o mine.html
    expect 2 --force
    check "leaves the file alone" test "$(cat mine.html)" = mine
    run report a.h5 -o missing/folder/a.html
    expect 5 missing/folder
    run run double-pendulum --set scheme.until=1 -o double.h5 --quiet
    run export double.h5 -o double
    expect 0 states.csv
    run report missing.h5
    expect 5 'no such file'
    cp a.h5 before.h5
    run report a.h5 --force -o ./a.h5
    expect 2 'would replace the file that is read'
    run compare a.h5 b.h5 --force -o a.h5
    expect 2 'would replace the file that is read'
    check "leaves the record alone" cmp -s a.h5 before.h5
    run report a.h5 --max-size nothing
    expect 2 'size in megabytes'
    run report a.h5 --max-size 0.01
    expect 2 'this record needs at least'
    least=$(sed -n 's/.* at least \([0-9.]*\) MB.*/\1/p' err)
    run report a.h5 --max-size "$least" -o least.html
    expect 0 least.html
    check "as small as it said" test "$(wc -c <least.html)" -le "$(awk "BEGIN { printf \"%d\", $least * 1e6 + 0.5 }")"
    run report a.h5 --max-size 1 --full
    expect 2
    run compare a.h5 b.h5 -o both.html
    expect 0 'levels = "fixed"'
    check "what is the same is not told" bash -c '! grep -q "until = 5" out'
    check "a page of both" test -s both.html
    run compare a.h5 b.h5 -o both.html --max-size 0.01
    expect 2 'these records need at least'
    run compare a.h5 b.h5 --json
    check "one JSON object" test "$(grep -c '^{"records"' out)" -eq 1
    run run kepler --set scheme.until=1 -o k.h5 --quiet
    run compare a.h5 k.h5
    expect 2 'nothing can be compared'
    run export a.h5
    expect 0 a-csv/states.csv
    check "a row for each level" test "$(wc -l <a-csv/levels.csv)" -eq "$(($(wc -l <a-csv/steps.csv) + 1))"
    run export a.h5
    expect 2 --force
    run export a.h5 --xdmf
    expect 2 'an orbit'
    write_problem
    printf '[invariants]\nI = "log(q - 5)"\nJ = "q"\n' >>problem.toml
    run run problem.toml -o u.h5
    check "a warning" grep -q 'the invariant I is not defined' err
    run compare u.h5 u.h5
    check "what is undefined has no deviation" grep -q '^  I  *undefined at the start; no value in .* levels  *undefined' out
    check "and what is defined has one" grep -q '^  J  *0, deviation ' out
    run compare u.h5 u.h5 --json
    check "nor in JSON" grep -q '"I": {"undefined": [0-9]*, "count": [0-9]*}, "J": {"initial": 0,' out
    run export u.h5
    check "nor has it a sign" grep -q '^0,0,.*,nan,0$' u-csv/levels.csv
    ;;
  lanes)
    # How many numbers the processor takes side by side changes no figure. 501 cells are chunks of two lengths.
    write_lattice
    sed -i 's/cells = 31/cells = 501/' lattice.toml
    write_problem
    for problem in lattice problem; do
      [ $problem = lattice ] || sed -i 's/^step = /lagrangian = "generating"\norder = 4\nstep = /' problem.toml
      for lanes in 2 4 8; do
        RUBATO_LANES=$lanes run run $problem.toml --set scheme.until=1 -o $problem-$lanes.h5
        expect 0
        run export $problem-$lanes.h5
        expect 0
        check "the same with $lanes lanes" diff -r $problem-2-csv $problem-$lanes-csv
      done
    done
    # Energies of several lengths side by side, in whole steps and by parts; nor does machine code change one.
    for problem in 'pendulum --set initial.p=1.9 --set scheme.step=0.76 --set scheme.until=60' \
      'outer-solar-system --set scheme.step=877 --set scheme.until=60000'; do
      for lanes in 2 4 8 none; do
        [ $lanes = none ] && export RUBATO_JIT=0 || export RUBATO_LANES=$lanes
        run run $problem --set scheme.lagrangian=splitting --set scheme.composition=blanes-moan-rkn-6 -o $lanes.h5
        expect 0
        unset RUBATO_JIT RUBATO_LANES
        run export $lanes.h5
        expect 0
        check "the same with $lanes lanes" diff -r 2-csv $lanes-csv
        rm $lanes.h5
        [ $lanes = 2 ] || rm -r $lanes-csv
      done
      rm -r 2-csv
    done
    run run lattice.toml --set scheme.until=1 --set scheme.step=0.100000001 -o other.h5
    run export other.h5
    check 'the comparison sees another step' test -n "$(diff -rq lattice-2-csv other-csv)"
    RUBATO_LANES=3 run run lattice.toml -o wrong.h5
    expect 2 'RUBATO_LANES has to be 2, 4 or 8'
    ;;
  completion)
    for shell in bash zsh fish; do
      run completion "$shell"
      expect 0 kepler
    done
    run completion tcsh
    expect 2 'bash, zsh or fish'
    run completion bash
    # What a user sees who types the words given and then Tab.
    complete_words() { bash -c '. ./out; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _rubato; echo "${COMPREPLY[*]}"' _ "$@"; }
    check "commands" test "$(complete_words rubato re)" = 'resume report'
    check "catalogue names" test "$(complete_words rubato show kep)" = kepler
    check "options" test "$(complete_words rubato run --th)" = --threads
    check "and nothing else" test -z "$(complete_words rubato run --nonsense)"
    check "topics of help" test "$(complete_words rubato help fo)" = formulas
    check "and commands" test "$(complete_words rubato help res)" = resume
    check "entries that --set changes" test "$(complete_words rubato run mine.toml --set scheme.comp)" = scheme.composition=
    check "tables with any names" test "$(complete_words rubato run --set param)" = parameters.
    check "entries that --unset removes" test "$(complete_words rubato run --unset output.ti)" = output.times
    check "and nothing else there" test -z "$(complete_words rubato run --unset output.tii)"
    ;;
  help)
    run help
    expect 0 'rubato show pendulum > mine.toml'
    run help formulas
    expect 0 'atan2(y, x)'
    run help problem
    expect 0 '[scheme]'
    check "lines fit a terminal" test "$(wc -L <out)" -le 100
    run help run
    expect 0 'Usage: rubato run'
    for table in scheme grid.x events.NAME output.quantities; do
      run help "$table"
      expect 0 "[$table]"
    done
    run help --man
    expect 0 '.TH RUBATO 1'
    cp out manual
    for command in $("$rubato" --help | awk '/^Subcommands:/ { inside = 1; next } /^$/ { inside = 0 } inside { print $1 }'); do
      check "the manual page has $command" grep -qx ".SS rubato $command" manual
    done
    check "and no command that is not there" test "$(grep -c '^.SS rubato ' manual)" -eq "$(grep -c . <("$rubato" --help | awk '/^Subcommands:/ { inside = 1; next } /^$/ { inside = 0 } inside'))"
    check "no text of it is a request" test -z "$(grep -E "^[.']" manual | grep -vE '^\.(TH|SH|SS|TP|PP|nf|fi)( |$)')"
    run help scheme
    expect 0 'step_potential'
    check "of one table alone" test -z "$(grep -F '[output]' out)"
    run help schem
    expect 2 'did you mean scheme?'
    for command in list show resume check help completion run scan converge advise solve report compare export; do
      run "$command" --help
      expect 0 "Usage: rubato $command"
      check "a text of its own: $command" test "$(grep -c 'rubato scan kepler\|a problem file to start from' out)" -lt 2
    done
    run resume --help
    expect 0 'rubato resume mine.h5 --until 200'
    run show pendulum --set scheme.step=0.25 --unset title
    expect 0 'step = 0.25'
    check "without what was removed" test -z "$(grep title out)"
    run run pendulum --unset scheme.stpe
    expect 2 'did you mean step?'
    run run pendulum --unset scheme.step=1
    expect 2 'expected table.key, without a value'
    run run pendulum --set scheme.step
    expect 2 'expected table.key=value'
    "$rubato" show pendulum | "$rubato" run - --set scheme.until=1 --unset title -o piped.h5 >out 2>err
    check "a problem on standard input" test -f piped.h5
    check "called so" grep -q '^stdin' out
    rm -f piped.h5
    echo 'x = ' | "$rubato" run - >out 2>err
    check "its place in messages" grep -q '^rubato: error: stdin:1:' err
    run run -
    expect 2 'the file is empty'
    run help formula
    expect 2 'did you mean formulas?'
    run help xyzzy
    expect 2 'Topics: formulas, problem'
    run hepl
    expect 2 'did you mean help?'
    run run pendulum --set step=0.1
    expect 2 'it belongs to [scheme]'
    run run pendulum --set 'hamiltonian.H=p^2/2 - cos(zz)'
    expect 2 'known here: p, q'
    run run sine-gordon-2d --set grid.y.cells=128
    expect 2 'Write cells = 135'
    run run pendulum --set scheme.max_steps=1e300
    expect 2 'too large'
    nothing_written
    ;;
  warnings)
    cp "$source_folder"/tests/defects/files/not-periodic.toml .
    run run not-periodic.toml
    expect 7
    check "what is lost, in an error" grep -q 'its result is lost: the spectrum is full' err
    accepted='verdict.accept=["spectrum", "period"]'
    run run not-periodic.toml --force --set "$accepted"
    expect 0
    check "a warning, once" test "$(grep -c 'is not periodic in x' err)" -eq 1
    run run not-periodic.toml --force --set "$accepted" --json
    check "JSON alone on standard output" test "$(grep -vc '^{.*}$' out)" -eq 0
    check "with the warning in it" grep -q '"warnings": \["the initial u is not periodic' out
    run run not-periodic.toml --force --set "$accepted" --quiet
    check "nothing when quiet" test ! -s err
    ;;
  interrupt)
    for signal in INT TERM HUP; do
      rm -f long.h5
      "$rubato" run pendulum --set scheme.until=1e7 -o long.h5 --json >out 2>err &
      process=$!
      wait_for_levels long.h5
      kill -$signal "$process"
      wait "$process"
      status=$?
      last="rubato run, then SIG$signal"
      check "status 130" test "$status" -eq 130
      check "JSON for status 130" grep -q '"status": *130' out
      steps=$(json steps)
      check "some steps were made" test "$steps" -gt 0
      run check long.h5 --json
      check "the record is whole" test "$(json steps)" -eq "$steps"
    done
    TMPDIR=$folder "$rubato" converge pendulum --set scheme.until=1e7 --json >out 2>err &
    process=$!
    until compgen -G 'rubato-converge-*/run.h5' >/dev/null; do sleep 0.05; done
    kill -INT "$process"
    wait "$process"
    status=$?
    last="rubato converge, then SIGINT"
    check "status 130" test "$status" -eq 130
    check "JSON for status 130" grep -q '"status": *130' out
    check "names the run" grep -q 'interrupted in the run with the whole of the step' err
    check "names no record" test "$(grep -c resume err)" -eq 0
    ;;
  damage)
    # Every byte counts somewhere: whatever is read of a damaged record, the program ends with a status that means it.
    run run pendulum --set scheme.until=5 -o a.h5 --quiet
    size=$(stat -c %s a.h5)
    for place in $(seq 40 "$((size / 60))" "$size"); do
      cp a.h5 b.h5
      head -c 24 /dev/zero | tr '\0' '\377' | dd of=b.h5 bs=1 seek="$place" conv=notrunc 2>/dev/null
      run check b.h5 --json
      check "status 0 or 5, damaged at $place" test "$status" -eq 0 -o "$status" -eq 5
      refused=$((${refused:-0} + (status == 5)))
    done
    check "damage was seen" test "$refused" -gt 10
    head -c 3000 a.h5 >b.h5
    run check b.h5
    expect 5 truncated
    # HDF5 frees what it never allocated when it lists the links of this one: with other contents of memory it crashes.
    cp "$source_folder/tests/defects/files/link-heap.h5" c.h5
    for command in 'check c.h5' 'report c.h5' 'export c.h5' 'resume c.h5 --until 100' 'compare c.h5 a.h5'; do
      run $command
      expect 5 c.h5
    done
    run compare a.h5 a.h5
    expect 0
    ;;
  sources)
    # In the library one crashes, and the other has no end.
    for name in crash hang; do
      sed "s|^from = .*|from = \"$source_folder/tests/defects/files/rel-from-$name.h5\"|" \
        "$source_folder/tests/defects/files/rel-from-$name.toml" >from.toml
      run run from.toml -o from.h5
      expect 5 "rel-from-$name.h5: is damaged"
      check "writes no record" test ! -e from.h5
    done
    run run pendulum --set scheme.until=5 -o a.h5 --quiet
    run run pendulum --set 'initial.from="a.h5"' --set scheme.until=6 -o from.h5 --quiet
    expect 0
    ;;
  lattice)
    run run sine-gordon --set grid.x.cells=101 --set scheme.until=2 --tangents -o a.h5 --json
    expect 0
    for key in h discrete_energy node_energy off_law gamma step_condition newton_iterations residuals energy momentum \
      variational_energy variational_momentum multisymplectic invariants topological_charge totals error u; do
      check "the key $key" grep -q "\"$key\": {\"" out
    done
    for key in status steps t wall_seconds; do
      check "the number $key" test -n "$(json $key)"
    done
    check "no number that is none" bash -c '! grep -qiE "nan|inf" out'
    residuals=$(grep -oE '"energy": \{"max.*"multisymplectic": \{[^}]*\}' out)
    run check a.h5 --json
    expect 0 step_equation
    check "the residuals of the run, digit by digit" test \
      "$(grep -oE '"energy": \{"max.*"multisymplectic": \{[^}]*\}' out)" = "$residuals"
    run check a.h5
    expect 0 'residual step_equation'
    run run sine-gordon-2d --set grid.x.cells=31 --set grid.y.cells=31 --set scheme.until=0.2 -o b.h5 --json --threads 1
    expect 0 momentum_y
    check "a file for ParaView beside the record of a plane" grep -q 'b.h5:/states/u' b.xdmf
    check "none beside that of a line" test ! -e a.xdmf
    lines=$(wc -l <b.xdmf)
    run resume b.h5 --until 0.4 --quiet
    check "which grows with it" test "$(wc -l <b.xdmf)" -gt "$lines"
    echo mine >b.xdmf
    run resume b.h5 --until 0.5
    check "and is left alone where it is not of this record" test "$(cat b.xdmf)" = mine
    check "which is said" grep -q 'b.xdmf is left as it is' err
    run run sine-gordon-2d --set grid.x.cells=31 --set grid.y.cells=31 --set scheme.until=0.2 -o b.h5 --json --threads 1 \
      --force
    one=$(sed 's/"wall_seconds.*//' out)
    run run sine-gordon-2d --set grid.x.cells=31 --set grid.y.cells=31 --set scheme.until=0.2 -o b.h5 --json --threads 2 \
      --force
    expect 0
    check "two threads say the same as one" test "$(sed 's/"wall_seconds.*//' out)" = "$one"
    run run maxwell --set grid.x.cells=5 --set grid.y.cells=5 --set grid.z.cells=5 --set scheme.until=0.3 -o c.h5 --json
    expect 0 momentum_z
    run check c.h5
    expect 0 'residual momentum_z'
    run run sine-gordon --set scheme.lagrangian=euler-box -o d.h5
    expect 2 'levels = "fixed"'
    run run sine-gordon --set scheme.lagrangian=euler-box --set scheme.levels=fixed --set scheme.until=1 -o d.h5 --json
    expect 0 variational_energy
    check "no Gamma, which it has not" bash -c '! grep -q gamma out'
    ;;
  lattice_input)
    run run sine-gordon --set grid.x.cells=400
    expect 2 401
    run run sine-gordon --set grid.x.cells=1000000000001
    expect 2 'memory'
    run run sine-gordon --set 'initial.u=log(x)'
    expect 2 'the initial u is'
    run run sine-gordon --set 'initial.w=sech(x)'
    expect 2 'contradicts its constraint (the row of w'
    "$rubato" show sine-gordon >good.toml
    sed 's/fields = .*/fields = ["u", "v", "w", "z1"]/' good.toml >bad.toml
    run run bad.toml
    expect 2 'the field z1 is not determined'
    { cat good.toml; printf '[symmetries]\nswap = [["u", "v", 1], ["v", "u", 1]]\n'; } >bad.toml
    run run bad.toml
    expect 2 'swap is not a symmetry'
    run run sine-gordn
    expect 2 'did you mean "sine-gordon"?'
    run show sine-gordon2d
    expect 2 'did you mean "sine-gordon-2d"?'
    nothing_written
    run run good.toml --set scheme.until=0.1
    expect 0
    ;;
  lattice_stop)
    write_lattice
    "$rubato" run lattice.toml -o killed.h5 --quiet --threads 1 2>err &
    process=$!
    wait_for_levels killed.h5
    kill -KILL "$process"
    wait "$process" 2>/dev/null
    last="rubato run, then SIGKILL"
    run check killed.h5 --json
    expect 0 step_equation
    check "levels were kept" test "$(json steps)" -gt 0
    killed=$(json steps)
    before=$(version killed.h5)
    "$rubato" resume killed.h5 --quiet --threads 1 >out 2>err &
    process=$!
    wait_for_version killed.h5 "$before"
    kill -INT "$process"
    wait "$process"
    status=$?
    last="rubato resume, then SIGINT"
    check "status 130" test "$status" -eq 130
    run check killed.h5 --json
    check "levels were added" test "$(json steps)" -gt "$killed"
    end=$(awk "BEGIN { print $(json t) + 2 }")
    run resume killed.h5 --until "$end" --json --threads 1
    expect 0
    resumed=$(sed 's/"wall_seconds.*//' out)
    run run lattice.toml --set scheme.until="$end" -o whole.h5 --json --threads 1
    expect 0
    check "resumed as if never stopped" test "$(sed 's/"wall_seconds.*//' out)" = "$resumed"
    run run lattice.toml --set scheme.until="$end" --set scheme.step=0.10000000000000002 -o whole.h5 --force --json \
      --threads 1
    check "another step is told apart" test "$(sed 's/"wall_seconds.*//' out)" != "$resumed"
    ;;
  memory)
    # Beforehand: the number, and what limits it.
    plane=(sine-gordon-2d --set scheme.until=0.2)
    (ulimit -v 3000000; "$rubato" run "${plane[@]}" --set grid.x.cells=4001 --set grid.y.cells=4001 -o never.h5 2>err)
    status=$?
    last='a run that does not fit under ulimit -v'
    expect 2 'bytes a node'
    check "names the limit" grep -q 'GB is available (ulimit -v)' err
    nothing_written
    (ulimit -v 3000000; "$rubato" run "${plane[@]}" --set grid.x.cells=45 --set grid.y.cells=45 --quiet -o fits.h5)
    check "the twin: a small one fits" test $? -eq 0
    # Later: memory taken away while the run is going.
    write_lattice
    "$rubato" run lattice.toml --set grid.x.cells=20001 -o short.h5 --quiet --threads 1 2>err &
    process=$!
    wait_for_levels short.h5
    if prlimit --pid "$process" --data=1000000 2>/dev/null; then
      # A run that happens to need no more goes on; it is ended, and its record is whole all the same.
      for _ in $(seq 300); do
        kill -0 "$process" 2>/dev/null || break
        sleep 0.1
      done
      if kill -KILL "$process" 2>/dev/null; then
        wait "$process" 2>/dev/null
      else
        wait "$process"
        status=$?
        last='a run that runs out of memory'
        expect 4 'not enough memory after t = '
        check "names the record" grep -q 'continue with `rubato resume short.h5`' err
      fi
      run check short.h5 --json
      check "the record is whole" test "$(json steps)" -gt 0
    else
      kill -KILL "$process"
      wait "$process" 2>/dev/null
    fi
    ;;
  dry_run)
    run run pendulum --dry-run
    expect 0 'nothing was run'
    for line in coordinates steps memory record time; do
      check "has a line: $line" grep -q "^  $line  *[a0-9]" out
    done
    run run pendulum --dry-run --quiet
    check "--quiet prints nothing" test ! -s out
    plane=(sine-gordon-2d --set scheme.lagrangian=euler-box --set scheme.levels=fixed --set scheme.until=0.2)
    run run "${plane[@]}" --dry-run --json -o plane.h5
    expect 0 '"dry_run": true'
    check "names the cells" grep -q '"cells": {"x": [0-9]*, "y": [0-9]*}' out
    check "names the file" grep -q '"file": "plane.h5"' out
    run run pendulum --set 'ensemble.grid.initial.p="0.1:1.5:30"' --dry-run --json
    expect 0 '"members": 30'
    nothing_written
    # The numbers of a run that does not fit, as the run itself has them; and a size that nobody can run.
    for option in --dry-run --quiet; do
      (ulimit -v 3000000
        "$rubato" run "${plane[@]}" --set grid.x.cells=4001 --set grid.y.cells=4001 -o never.h5 $option >out 2>err)
      status=$?
      last="run $option of what does not fit"
      expect 2 'bytes a node'
      check "says all" grep -qE 'GB is available \(ulimit -v\); its record would take .*B; .* steps would take about' err
      check "prints nothing" test ! -s out
    done
    run run "${plane[@]}" --dry-run --set grid.x.cells=3000001 --set grid.y.cells=3000001
    expect 2 '9.00001e+12 nodes'
    run run pendulum --dry-run --set scheme.step=0
    expect 2 'step'
    nothing_written
    ;;
  example)
    run run "$source_folder/examples/pendulum.toml" --json
    expect 0 max_relative_deviation
    # With variable levels the discrete energy is exact up to the tolerance of the level equation, 1e-13 relative.
    deviation=$(json max_relative_deviation)
    check "discrete energy held to 1e-13" awk "BEGIN { exit !($deviation <= 1e-13) }"
    run run "$source_folder/examples/pendulum.toml" --set scheme.levels=fixed -o fixed.h5 --json
    deviation=$(json max_relative_deviation)
    check "and not so with fixed levels" awk "BEGIN { exit !($deviation > 1e-13) }"
    ;;
  *)
    echo "no case $case_name"
    exit 1
    ;;
esac

[ "$failures" -eq 0 ] || { echo "$failures failed"; exit 1; }
