#!/usr/bin/env bash
# run_target.sh TARGET CORPUS [MAX_LEN [RUNS]]: runs a fuzz target from its corpus, for
# PALPATE_FUZZ_RUNS inputs of at most MAX_LEN bytes (600). Unless that is set: RUNS inputs (200000),
# the same ones each time, so that a change is judged by what it changes.
# New inputs are thrown away; one that breaks something stays where this is run, as
# crash-* or timeout-*.
set -euo pipefail
target=$1 corpus=$2
seed=1 runs=${4:-200000}
if [ -n "${PALPATE_FUZZ_RUNS:-}" ]; then
  seed=0 runs=$PALPATE_FUZZ_RUNS # 0: another one each time
fi
found=$(mktemp -d)
trap 'rm -rf "$found"' EXIT
export UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1}
SECONDS=0
"$target" -seed="$seed" -runs="$runs" -max_len="${3:-600}" -timeout=10 \
  -rss_limit_mb=2048 -verbosity=0 -print_final_stats=1 "$found" "$corpus" 2>&1 | tee "$found.log" ||
  { rm -f "$found.log"; exit 1; }
inputs=$(awk '/number_of_executed_units/ { print $2 }' "$found.log")
rm -f "$found.log"
echo "$(basename "$target"): $inputs inputs in $SECONDS s"
