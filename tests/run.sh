#!/usr/bin/env bash
# Installs what is missing, builds everything and runs every test; ends with the
# counts. Real volumes are read from PALPATE_DATA_DIR (../shared/data unless set);
# tests that need one are skipped where it is not there.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

usage() {
  cat <<'TEXT'
Usage: tests/run.sh [--sanitizers] [--long] [--packages]

Without options: the optimised build and every test in it, in their short forms, and
the Debian packages, built and looked at. Tests that judge times run apart. Tests of whole
programs that fail are run again, alone, because a machine that stops for a moment fails
them; each failure is shown. Those of times may fail twice, others once. Where more than ten
fail or among them pure code, a program that crashed or does not end when told to, something
that a sanitizer found, or something wrong that no slowness explains (the stylus inside
material, a copy that differs), none is.

  --sanitizers  then every test but those of times under AddressSanitizer and
           UndefinedBehaviorSanitizer, the pure code and the threads around the servo
           under ThreadSanitizer, and the fuzz targets
  --long   the long forms of torture and slide tests (an hour), and ten million
           inputs for each fuzz target (another, with --sanitizers)
  --packages  installs the Debian packages in a root of their own as well (as root,
           minutes); without it they are only built and looked at
TEXT
}

sanitizers=
packages=()
for argument in "$@"; do
  case "$argument" in
    --sanitizers) sanitizers=yes ;;
    --packages) packages=(--install) ;;
    --long)
      export PALPATE_TORTURE=${PALPATE_TORTURE:-100}
      export PALPATE_FUZZ_RUNS=${PALPATE_FUZZ_RUNS:-10000000}
      ;;
    -h | --help) usage; exit 0 ;;
    *) echo "run.sh: unknown argument $argument (see --help)" >&2; exit 2 ;;
  esac
done

"$root/deploy/install-packages.sh"
cd "$root"
results=$(mktemp -d)
trap 'rm -rf "$results"' EXIT

# stage NAME: a headline, with the time since the start.
stage() { printf '== %02d:%02d %s\n' $((SECONDS / 60)) $((SECONDS % 60)) "$1"; }

# build PRESET TARGET
build() {
  stage "$1: build"
  cmake --preset "$1" >"$results/build.log" || { cat "$results/build.log"; exit 1; }
  cmake --build --preset "$1" --target "$2" >"$results/build.log" 2>&1 ||
    { grep -E 'error|FAILED|warning' "$results/build.log" || tail -n 30 "$results/build.log"; exit 1; }
}

# run_once PRESET NAME [ARGUMENT...]: with these arguments of ctest
run_once() {
  local log=$results/$2.log
  stage "$2: test"
  # What failed is counted below; no test at all is an error of its own. Where none failed,
  # ctest leaves the list as it was.
  [[ "$2" = *again* ]] || rm -f "$(failed_list "$1")"
  if ctest --preset "$1" "${@:3}" --output-junit "$results/$2.xml" >"$log"; then
    rm -f "$(failed_list "$1")"
  elif [ ! -s "$(failed_list "$1")" ]; then
    echo "run.sh: ctest failed in $2, and no test did" >&2
    exit 1
  fi
  grep -vE '^ *[0-9]+/[0-9]+ Test .* Passed|^ +Start +[0-9]+:' "$log" || true
  # One of a file of Python does not skip the file.
  sed -n "s/^.*\.\.\. skipped '\(.*\)'$/  a Python test was skipped: \1/p" \
    "$(dirname "$(failed_list "$1")")/LastTest.log" 2>/dev/null || true
  grep -q '<testcase ' "$results/$2.xml" || { echo "run.sh: no test was run of $2" >&2; exit 1; }
}

# failed_list PRESET: where ctest keeps the names of what failed or could not be run
failed_list() {
  local folder=build
  [ "$1" = default ] || folder=build-$1
  echo "$folder/Testing/Temporary/LastTestsFailed.log"
}

count() { grep -cs "$@" || true; }

# Only failures that a slow machine may explain: few, of whole programs, and among all of them
# no crash, no program that does not end when told to, no test that hangs, no finding of a
# sanitizer and nothing that is wrong however slow the machine (tests say ***Wrong).
may_run_again() {
  local list
  list=$(failed_list "$1")
  [ -s "$list" ] || return 1
  if grep -v '^[0-9]*:integration\.' "$list" || [ "$(count . "$list")" -gt 10 ] ||
    grep -E '\*\*\*(Exception|Timeout|Not Run|Wrong)|runtime error:|Sanitizer:' "$results/$2.log"; then
    echo "run.sh: no failure is excused by a slow machine beside these: none is run again"
    return 1
  fi
}

tests=0 skipped=0 failed=0 later=0

# run_tests PRESET NAME TRIES [ARGUMENT...]: what failed is run again, alone
run_tests() {
  local ran first last try again=$2
  run_once "$1" "$2" "${@:4}"
  ran=$(count '<testcase .*status="run"' "$results/$2.xml")
  first=$(count . "$(failed_list "$1")")
  for ((try = 2; try <= $3; ++try)); do
    may_run_again "$1" "$again" || break
    again=$2-again-$try
    run_once "$1" "$again" --rerun-failed --parallel 1
  done
  last=$(count . "$(failed_list "$1")")
  tests=$((tests + $(count '<testcase ' "$results/$2.xml")))
  skipped=$((skipped + $(count '<testcase ' "$results/$2.xml") - ran - first))
  failed=$((failed + last))
  later=$((later + first - last))
}

# Programs are most of what a build takes on the disk, and linked again in seconds.
drop_programs() { find "$1/bin" "$1/tests" -maxdepth 1 -type f -perm -100 -delete 2>/dev/null || true; }

build default all
run_tests default default 2 --label-exclude times
# Those that need the machine for themselves.
run_tests default times 3 --label-regex times
packages_failed=
stage packages
tests/packages_test.sh ${packages[@]+"${packages[@]}"} || packages_failed=yes
if [ -n "$sanitizers" ]; then
  build asan all
  run_tests asan asan 2
  drop_programs build-asan
  build tsan thread_tests
  run_tests tsan tsan 1
  drop_programs build-tsan
  build fuzz all
  run_tests fuzz fuzz 1
  sed -n 's/^\(.*_fuzz: [0-9]* inputs in [0-9]* s\)$/  \1/p' build-fuzz/Testing/Temporary/LastTest.log
fi
stage done
printf '%d passed, %d failed, %d skipped (%d passed when run again)\n' \
  $((tests - failed - skipped)) "$failed" "$skipped" "$later"
[ -z "$packages_failed" ] || { echo "run.sh: the packages failed, see above" >&2; exit 1; }
[ "$failed" -eq 0 ]
