#!/usr/bin/env bash
# Installs missing packages, builds the tests, runs them, and prints the counts at the end.
# Real volumes are read from PALPATE_DATA_DIR (default: ../shared/data). Tests that need a missing
# volume are skipped.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
data=${PALPATE_DATA_DIR:-$root/../shared/data}

usage() {
  cat <<'TEXT'
Usage: tests/run.sh [--all | PART...]

Without options: builds and runs the core, which every change must pass. No test of the core
judges the clock, and none is run twice.

  --all         everything: the core, and all parts below
  --wide        the core, and the long and wide tests
  --times       what judges times, alone on the machine; a failed test gets two more tries
  --packages    builds the Debian packages and looks at them; as root also installs, upgrades and
                removes them in a root of their own
  --sanitizers  the core under AddressSanitizer and UndefinedBehaviorSanitizer, tests with threads
                under ThreadSanitizer, the fuzz targets; and every header by itself

PALPATE_TORTURE=N makes the loops of random tests N times as long (default: 1; with --all and
--wide: 10). PALPATE_FUZZ_RUNS=N: inputs for each fuzz target.
TEXT
}

parts=()
while [ $# -gt 0 ]; do
  case "$1" in
    --all) parts=(wide times packages sanitizers); export PALPATE_BUDGET_S=600 ;;
    --wide | --times | --packages | --sanitizers) parts+=("${1#--}") ;;
    -h | --help) usage; exit 0 ;;
    *) echo "run.sh: unknown argument $1 (see --help)" >&2; exit 2 ;;
  esac
  shift
done
has() { [[ " ${parts[*]-} " = *" $1 "* ]]; }
if [ ${#parts[@]} -eq 0 ]; then
  tests=core parts=(core) sections=(demo import web core)
else
  tests=all sections=()
fi

"$root/deploy/install-packages.sh" ${sections[@]+"${sections[@]}"}
cd "$root"
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT

# stage NAME: prints a headline with the time since the start.
stage() { printf '== %02d:%02d %s\n' $((SECONDS / 60)) $((SECONDS % 60)) "$1"; }

# build PRESET TARGET...
build() {
  stage "$1: build"
  cmake --preset "$1" -DPALPATE_TESTS="$tests" -DPALPATE_DATA_DIR="$data" >"$results/build.log" ||
    { cat "$results/build.log"; exit 1; }
  deploy/build.sh "$(folder "$1")" "${@:2}"
}

# folder PRESET: prints its build folder
folder() { [ "$1" = default ] && echo build || echo "build-$1"; }

# stolen: prints the ticks that the host of a virtual machine gave to others, and all ticks
stolen() { awk '/^cpu / { print $9, $2 + $3 + $4 + $5 + $6 + $7 + $8 + $9; exit }' /proc/stat; }

passed=0 skipped=0 cases_failed=0 failed=() summary=()

# run_tests NAME PRESET [ARGUMENT...]: runs tests, and shows the output of those that fail
run_tests() {
  local name=$1 preset=$2 began=$SECONDS before log=$results/$1.log line
  local cases cases_skipped failures failed_before=${#failed[@]}
  stage "$name: test"
  before=$(stolen)
  # Whole outputs: the counts of a program's cases are read from them.
  ctest --preset "$preset" "${@:3}" --output-junit "$results/$name.xml" \
    --test-output-size-passed 4000000 --test-output-size-failed 4000000 >"$log" || true
  # Why cases were skipped, of Python's tests, of GoogleTest's and of Node's.
  sed -n -e "s/^.*\.\.\. skipped '\(.*\)'$/  skipped: \1/p" -e '/: Skipped$/{n;s/^/  skipped: /p;}' \
    -e 's/^ *ok [0-9]* - .* # SKIP \(.*\)$/  skipped: \1/p' \
    "$(folder "$preset")/Testing/Temporary/LastTest.log" 2>/dev/null || true
  read -r cases cases_skipped failures < <(tests/support/count_cases.py "$results/$name.xml")
  [ "$cases" -gt 0 ] || { cat "$log"; echo "run.sh: no test was run of $name" >&2; exit 1; }
  if ! grep -q '^100% tests passed' "$log"; then
    cat "$log"
    while IFS= read -r line; do failed+=("$name: $line"); done < \
      <(sed -n '/^The following tests FAILED:/,$s/^\t *[0-9]* - //p' "$log" | grep -v '(Skipped)$')
    # Also where ctest itself failed, and named no test.
    [ ${#failed[@]} -gt "$failed_before" ] ||
      { failed+=("$name: ctest"); cases_failed=$((cases_failed + 1)); }
  fi
  passed=$((passed + cases - cases_skipped - failures))
  skipped=$((skipped + cases_skipped)) cases_failed=$((cases_failed + failures))
  summary+=("$(printf '%-11s %5d tests in %2d min %02d s; the host took %s %% of the processors' \
    "$name" "$cases" $(((SECONDS - began) / 60)) $(((SECONDS - began) % 60)) \
    "$(awk '{ print int(100 * ($3 - $1) / ($4 > $2 ? $4 - $2 : 1)) }' <<<"$before $(stolen)")")")
}

# run_alone NAME COMMAND...: a check that is no test of ctest's
run_alone() {
  local name=$1 began=$SECONDS
  stage "$name"
  "${@:2}" || { failed+=("$name"); cases_failed=$((cases_failed + 1)); }
  summary+=("$(printf '%-11s in %2d min %02d s' \
    "$name" $(((SECONDS - began) / 60)) $(((SECONDS - began) % 60)))")
}

run_sanitizers() {
  run_alone headers build default header_check
  tests=core
  local preset
  for preset in tsan fuzz asan; do
    case $preset in
      tsan) build tsan thread_tests ;;
      fuzz) build fuzz all ;;
      asan) build asan tests ;;
    esac
    run_tests "$preset" "$preset"
    # Programs use most of the disk space of a build, and are linked again in seconds.
    find "build-$preset/bin" "build-$preset/tests" -maxdepth 1 -type f -perm -100 -delete 2>/dev/null || true
  done
  sed -n 's/^\(.*_fuzz: [0-9]* inputs in [0-9]* s\)$/  \1/p' \
    build-fuzz/Testing/Temporary/LastTest.log 2>/dev/null || true
}

if has core || has wide || has times; then build default tests; fi
if has core; then run_tests core default; fi
if has wide; then PALPATE_TORTURE=${PALPATE_TORTURE:-10} run_tests wide default --label-exclude times; fi
if has times; then run_tests times default --label-regex times --repeat until-pass:3; fi
if has packages; then
  build default all
  install=()
  [ "$(id -u)" -ne 0 ] || install=(--install)
  run_alone packages tests/packages_test.sh ${install[@]+"${install[@]}"}
fi
if has sanitizers; then run_sanitizers; fi

stage done
printf '%s\n' "${summary[@]}"
[ ${#failed[@]} -eq 0 ] || printf 'failed: %s\n' "${failed[@]}"
printf '%d passed, %d failed, %d skipped\n' "$passed" "$cases_failed" "$skipped"
[ ${#failed[@]} -eq 0 ]
