#!/usr/bin/env bash
# Installs missing packages, builds everything, runs every test, and prints the counts at the end.
# Real volumes are read from PALPATE_DATA_DIR (default: ../shared/data). Tests that need a missing
# volume are skipped.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

usage() {
  cat <<'TEXT'
Usage: tests/run.sh [--sanitizers] [--long] [--packages] [--within MINUTES]

Without options: makes the optimised build, runs every test in its short form, and builds and
checks the Debian packages. Tests that judge times run separately.

A failed test may be run again, alone: once, or twice if it judges times. The condition is that
every failed assertion is marked as one that a busy machine may explain: a latency, a rate or a
count (tests/support/excuse.h, excuse.py). If more than ten tests would be run again, none is.

The host of a virtual machine may give the processors to others. A run that lost 5 % of the
processors' time is not counted, for at most five such runs. After a loss of 10 %, also more than
ten tests are run again. The last lines name and count the tests that passed only in a later run.

  --sanitizers  afterwards also runs a part of the tests under AddressSanitizer and
           UndefinedBehaviorSanitizer, tests with threads under ThreadSanitizer, and the fuzz
           targets; and checks that every header of the last 30 commits compiles by itself
  --long   runs the long forms of torture and slide tests (an hour); with --sanitizers all tests
           except those that judge times, every header, and ten million inputs for each fuzz
           target (another hour)
  --packages  also installs the Debian packages in a root of their own (as root, minutes)
  --within MINUTES  leaves out a sanitizer if building for it would take longer than the whole run
           may. The last lines name what was left out. What was built is in ccache for the next run.
TEXT
}

sanitizers= within_min= left_out=()
packages=()
# The short form under AddressSanitizer: all unit tests, the daemon's own tests in C++, the readers
# and the fuzzed calls. The other tests run the same code from outside, with pictures, on real
# volumes or through Python, and take most of the time.
chosen=(--exclude-regex
  '^(offline|(lab_volume|view_render)_test|integration\.(python|remote|view|sdk_install|vdb_tool|sparse_volume|reshape|operations_(budget|demo|faults|guides|metrics|power_loss|restore|soak|unread)))')
address_tests=address_tests
# Only headers of the last commits: all headers take ten minutes.
headers=header_check_recent
while [ $# -gt 0 ]; do
  case "$1" in
    --sanitizers) sanitizers=yes ;;
    --packages) packages=(--install) ;;
    --within)
      [[ "${2-}" =~ ^[1-9][0-9]*$ ]] || { echo "run.sh: --within needs minutes" >&2; exit 2; }
      within_min=$2
      shift
      ;;
    --long)
      export PALPATE_TORTURE=${PALPATE_TORTURE:-100}
      export PALPATE_FUZZ_RUNS=${PALPATE_FUZZ_RUNS:-10000000}
      chosen=() address_tests=all headers=header_check
      ;;
    -h | --help) usage; exit 0 ;;
    *) echo "run.sh: unknown argument $1 (see --help)" >&2; exit 2 ;;
  esac
  shift
done

"$root/deploy/install-packages.sh"
cd "$root"
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT

# stage NAME: prints a headline with the time since the start.
stage() { printf '== %02d:%02d %s\n' $((SECONDS / 60)) $((SECONDS % 60)) "$1"; }

# build PRESET TARGET...
build() {
  stage "$1: build"
  cmake --preset "$1" >"$results/build.log" || { cat "$results/build.log"; exit 1; }
  deploy/build.sh "$(folder "$1")" "${@:2}"
}

# sanitize PRESET TARGET TEST_MINUTES TRIES [ARGUMENT...]: builds for a sanitizer and runs its tests,
# which take up to TEST_MINUTES, if the time is enough
sanitize() {
  local left_s=$((within_min * 60 - $3 * 60 - SECONDS)) rc=0
  if [ -z "$within_min" ]; then
    build "$1" "$2"
  elif [ "$left_s" -le 0 ]; then
    rc=124
  else
    stage "$1: build, for at most $((left_s / 60)) min"
    cmake --preset "$1" >"$results/build.log" || { cat "$results/build.log"; exit 1; }
    timeout "$left_s" deploy/build.sh "$(folder "$1")" "$2" || rc=$?
    [ "$rc" = 0 ] || [ "$rc" = 124 ] || exit 1
  fi
  if [ "$rc" = 0 ]; then run_tests "$1" "$1" "$4" "${@:5}"; else left_out+=("$1"); fi
  drop_programs "$(folder "$1")"
}

# folder PRESET: prints its build folder
folder() { [ "$1" = default ] && echo build || echo "build-$1"; }

# The most seconds, in all, to wait for a host that gives the processors to others.
patience_s=600
# A run that lost this share of the processors' time is not counted, at most so many per run_tests.
stolen_most_percent=5 uncounted_most=5

# stolen: prints the host's ticks for others, and all ticks, since the machine's start
stolen() { awk '/^cpu / { print $9, $2 + $3 + $4 + $5 + $6 + $7 + $8 + $9; exit }' /proc/stat; }

# stolen_since TICKS: prints the percentage since `stolen` printed TICKS
stolen_since() {
  awk '{ print int(100 * ($3 - $1) / ($4 > $2 ? $4 - $2 : 1)) }' <<<"$1 $(stolen)"
}

# run_once PRESET NAME [ARGUMENT...]: runs ctest once with these arguments
run_once() {
  local log=$results/$2.log before
  patience_s=$((patience_s - $(tests/support/await_processors.py "$patience_s")))
  stage "$2: test"
  before=$(stolen)
  # Failures are counted below. If no test ran, that is an error of its own. If no test failed,
  # ctest does not change the list.
  [[ "$2" = *again* ]] || rm -f "$(failed_list "$1")"
  # A program prints the counts of its cases at the end, so the beginning may be cut.
  if ctest --preset "$1" "${@:3}" --output-junit "$results/$2.xml" --test-output-truncation head \
    --test-output-size-failed 4000000 >"$log"; then
    rm -f "$(failed_list "$1")"
  elif [ ! -s "$(failed_list "$1")" ]; then
    echo "run.sh: ctest failed in $2, and no test did" >&2
    exit 1
  fi
  stolen_percent=$(stolen_since "$before")
  [ "$stolen_percent" -lt "$stolen_most_percent" ] ||
    echo "  others took $stolen_percent % of the processors' time meanwhile"
  # judge.py shows the failures.
  sed -n '/^[0-9]*% tests passed/,$p' "$log"
  # A skipped Python test does not skip its file, so ctest does not show it.
  sed -n "s/^.*\.\.\. skipped '\(.*\)'$/  a Python test was skipped: \1/p" \
    "$(dirname "$(failed_list "$1")")/LastTest.log" 2>/dev/null || true
  grep -q '<testcase ' "$results/$2.xml" || { echo "run.sh: no test was run of $2" >&2; exit 1; }
}

# failed_list PRESET: prints the path of ctest's list of tests that failed or could not run
failed_list() { echo "$(folder "$1")/Testing/Temporary/LastTestsFailed.log"; }

tests=0 skipped=0 stolen_percent=0 failed=() excused=()

# run_tests PRESET NAME TRIES [ARGUMENT...]: runs tests; runs excusable failures again, alone
run_tests() {
  local list again ran run=$2 try=1 uncounted=0 without
  list=$(failed_list "$1") again=$results/again
  run_once "$1" "$2" "${@:4}"
  read -r ran without < <(tests/support/count_cases.py "$results/$2.xml")
  tests=$((tests + ran))
  skipped=$((skipped + without))
  while true; do
    touch "$list"
    tests/support/judge.py "$results/$run.xml" "$results/$run.log" "$stolen_percent" >"$again"
    names "$list" >"$results/left"
    [ "$run" = "$2" ] || mapfile -t -O "${#excused[@]}" excused < <(grep -vxFf "$results/left" "$results/tried")
    if [ "$stolen_percent" -ge "$stolen_most_percent" ] && [ "$uncounted" -lt "$uncounted_most" ]; then
      uncounted=$((uncounted + 1))
    else
      try=$((try + 1))
    fi
    [ "$try" -le "$3" ] || : >"$again"
    names "$again" >"$results/tried"
    mapfile -t -O "${#failed[@]}" failed < <(grep -vxFf "$results/tried" "$results/left")
    [ -s "$again" ] || return 0
    cp "$again" "$list"
    run=$2-again-$((try + uncounted))
    run_once "$1" "$run" --rerun-failed --parallel 1
  done
}

# names FILE: prints the names of the tests in a list of ctest's
names() { cut -d: -f2- "$1"; }

# Deletes programs: they use most of the disk space of a build, and are linked again in seconds.
drop_programs() { find "$1/bin" "$1/tests" -maxdepth 1 -type f -perm -100 -delete 2>/dev/null || true; }

build default all
run_tests default default 2 --label-exclude times
# Tests that need the whole machine.
run_tests default times 3 --label-regex times
packages_failed=
stage packages
tests/packages_test.sh ${packages[@]+"${packages[@]}"} || packages_failed=yes
if [ -n "$sanitizers" ]; then
  build default "$headers"
  # The longest comes last: if the time is not enough, only that one is left out.
  sanitize tsan thread_tests 4 1
  sanitize fuzz all 4 1
  sed -n 's/^\(.*_fuzz: [0-9]* inputs in [0-9]* s\)$/  \1/p' build-fuzz/Testing/Temporary/LastTest.log \
    2>/dev/null || true
  sanitize asan "$address_tests" 14 2 ${chosen[@]+"${chosen[@]}"}
fi
stage done
[ ${#left_out[@]} -eq 0 ] || printf 'left out, not enough time to build: %s\n' "${left_out[@]}"
[ ${#excused[@]} -eq 0 ] || printf 'excused by a busy machine: %s\n' "${excused[@]}"
[ ${#failed[@]} -eq 0 ] || printf 'failed: %s\n' "${failed[@]}"
printf '%d passed, %d failed, %d skipped (%d excused)\n' \
  $((tests - ${#failed[@]} - skipped)) "${#failed[@]}" "$skipped" "${#excused[@]}"
[ -z "$packages_failed" ] || { echo "run.sh: the packages failed, see above" >&2; exit 1; }
[ ${#failed[@]} -eq 0 ]
