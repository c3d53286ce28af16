#!/usr/bin/env bash
# run_target.sh TARGET CORPUS [MAX_LEN [RUNS]]: runs a fuzz target from its corpus, for
# PALPATE_FUZZ_RUNS inputs (RUNS, or 200000, unless set) of at most MAX_LEN bytes (600).
# New inputs are thrown away; one that breaks something stays where this is run, as
# crash-* or timeout-*.
set -euo pipefail
target=$1 corpus=$2
found=$(mktemp -d)
trap 'rm -rf "$found"' EXIT
SECONDS=0
"$target" -runs="${PALPATE_FUZZ_RUNS:-${4:-200000}}" -max_len="${3:-600}" -timeout=10 \
  -rss_limit_mb=2048 -verbosity=0 -print_final_stats=1 "$found" "$corpus" 2>&1 | tee "$found.log" ||
  { rm -f "$found.log"; exit 1; }
inputs=$(awk '/number_of_executed_units/ { print $2 }' "$found.log")
rm -f "$found.log"
echo "$(basename "$target"): $inputs inputs in $SECONDS s"
