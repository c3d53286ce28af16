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
the Debian packages, built and looked at. Tests that judge times run apart. A test of
whole programs that fails is run again, alone, and shown: a machine that stops for a moment
fails it. One of times may fail twice, any other once; pure code, crashes and what a
sanitizer finds are not forgiven.

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

# run_tests PRESET NAME [ARGUMENT...]: with these arguments of ctest
run_tests() {
  local log=$results/$2.log folder=build
  [ "$1" = default ] || folder=build-$1
  stage "$2: test"
  # A failed test is counted below; no test at all is an error of its own.
  ctest --preset "$1" "${@:3}" --output-junit "$results/$2.xml" >"$log" || true
  grep -vE '^ *[0-9]+/[0-9]+ Test .* Passed|^ +Start +[0-9]+:' "$log" || true
  # One of a file of Python does not skip the file.
  sed -n "s/^.*\.\.\. skipped '\(.*\)'$/  a Python test was skipped: \1/p" \
    "$folder/Testing/Temporary/LastTest.log" 2>/dev/null || true
  [ -s "$results/$2.xml" ] || { echo "run.sh: no test was run of $2" >&2; exit 1; }
}

# run_again PRESET NAME: what failed of NAME, if it was run, alone
run_again() {
  local failed
  [ -s "$results/$2.xml" ] || return 0
  ! grep -qE '\*\*\*Exception|runtime error:|(ERROR|WARNING): [A-Za-z]+Sanitizer' "$results/$2.log" ||
    return 0
  failed=$(sed -n 's/.*<testcase name="\(integration\.[^"]*\)".* status="fail".*/\1/p' \
    "$results/$2.xml" | paste -sd '|')
  [ -n "$failed" ] || return 0
  run_tests "$1" "$2-again" --parallel 1 --tests-regex "^($failed)\$"
}

# Programs are most of what a build takes on the disk, and linked again in seconds.
drop_programs() { find "$1/bin" "$1/tests" -maxdepth 1 -type f -perm -100 -delete 2>/dev/null || true; }

build default all
run_tests default default --label-exclude times
run_again default default
# Those that need the machine for themselves.
run_tests default times --label-regex times
run_again default times
run_again default times-again
packages_failed=
stage packages
tests/packages_test.sh ${packages[@]+"${packages[@]}"} || packages_failed=yes
if [ -n "$sanitizers" ]; then
  build asan all
  run_tests asan asan
  run_again asan asan
  drop_programs build-asan
  build tsan core_tests
  run_tests tsan tsan
  drop_programs build-tsan
  build fuzz all
  run_tests fuzz fuzz
  sed -n 's/^\(.*_fuzz: [0-9]* inputs in [0-9]* s\)$/  \1/p' build-fuzz/Testing/Temporary/LastTest.log
fi
stage done
# The counts, over all runs. What was run again counts as it ended.
awk '
  FNR == 1 { in_suite = 0; again = FILENAME ~ /-again\.xml$/ }
  match($0, /<testsuite /) { in_suite = 1 }
  in_suite && match($0, /tests="[0-9]+"/) { count = substr($0, RSTART + 7, RLENGTH - 8) }
  in_suite && match($0, /failures="[0-9]+"/) { wrong = substr($0, RSTART + 10, RLENGTH - 11) }
  in_suite && match($0, /disabled="[0-9]+"/) { skipped += substr($0, RSTART + 10, RLENGTH - 11) }
  in_suite && match($0, /skipped="[0-9]+"/) { skipped += substr($0, RSTART + 9, RLENGTH - 10) }
  in_suite && />/ {
    in_suite = 0
    failed += wrong
    if (again) { failed -= count; later += count - wrong } else tests += count
  }
  END {
    printf "%d passed (%d of them not at once), %d failed, %d skipped\n",
      tests - failed - skipped, later, failed, skipped
    exit failed > 0 || tests == 0
  }' "$results"/*.xml
[ -z "$packages_failed" ] || { echo "run.sh: the packages failed, see above" >&2; exit 1; }
