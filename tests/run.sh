#!/usr/bin/env bash
# Installs what is missing, builds everything and runs every test; ends with the
# counts. Real volumes are read from PALPATE_DATA_DIR (../shared/data unless set);
# tests that need one are skipped where it is not there.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

usage() {
  cat <<'TEXT'
Usage: tests/run.sh [--quick] [--long]

  --quick  the optimised build only, without the sanitizer builds and the fuzzer
  --long   the long forms of torture and slide tests (an hour), and ten million
           inputs for each fuzz target (another)
TEXT
}

quick=
for argument in "$@"; do
  case "$argument" in
    --quick) quick=yes ;;
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

# run_preset PRESET TARGET CTEST_ARGUMENTS...
run_preset() {
  local preset=$1 target=$2
  shift 2
  echo "== $preset: build"
  cmake --preset "$preset" >"$results/$preset.log" || { cat "$results/$preset.log"; exit 1; }
  cmake --build --preset "$preset" --target "$target" >"$results/$preset.log" 2>&1 ||
    { grep -E 'error|FAILED|warning' "$results/$preset.log" || tail -n 30 "$results/$preset.log"; exit 1; }
  echo "== $preset: test"
  local directory=build
  [ "$preset" = default ] || directory=build-$preset
  # A failed test is counted below; no test at all is an error of its own.
  ctest --test-dir "$directory" --no-tests=error --output-on-failure \
    --output-junit "$results/$preset.xml" "$@" >"$results/$preset.log" || true
  grep -vE '^ *[0-9]+/[0-9]+ Test .* Passed|^ +Start +[0-9]+:' "$results/$preset.log" || true
  [ -s "$results/$preset.xml" ] || { echo "run.sh: no test was run in $directory" >&2; exit 1; }
}

run_preset default all -j1
if [ -z "$quick" ]; then
  # gRPC and OpenVDB's allocator are not built with sanitizers: the pure code and
  # the threads around it are.
  run_preset asan sanitized_tests -L sanitized -j2
  run_preset tsan sanitized_tests -L sanitized -j2
  run_preset fuzz all -j2
  sed -n 's/^\(.*_fuzz: [0-9]* inputs in [0-9]* s\)$/  \1/p' build-fuzz/Testing/Temporary/LastTest.log
fi

# The counts, over all runs.
awk '
  match($0, /<testsuite /) { in_suite = 1 }
  in_suite && match($0, /tests="[0-9]+"/) { tests += substr($0, RSTART + 7, RLENGTH - 8) }
  in_suite && match($0, /failures="[0-9]+"/) { failed += substr($0, RSTART + 10, RLENGTH - 11) }
  in_suite && match($0, /disabled="[0-9]+"/) { skipped += substr($0, RSTART + 10, RLENGTH - 11) }
  in_suite && match($0, /skipped="[0-9]+"/) { skipped += substr($0, RSTART + 9, RLENGTH - 10) }
  in_suite && />/ { in_suite = 0 }
  END {
    printf "%d passed, %d failed, %d skipped\n", tests - failed - skipped, failed, skipped
    exit failed > 0 || tests == 0
  }' "$results"/*.xml
