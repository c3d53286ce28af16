#!/usr/bin/env bash
# What 64 viewers at 60 Hz, 8 at 1 kHz, 50 settings and 20 edits per second cost the
# servo: ten windows in turn without and with them, 2 minutes in all, a table and a
# verdict. Nothing else should run on the machine.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
case "${1:-}" in
  -h | --help)
    echo "Usage: tests/load.sh [--seconds N]"
    exit 0
    ;;
  --seconds) seconds=$2 ;;
  *) seconds=120 ;;
esac
cd "$root"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
{ cmake --preset default -DPALPATE_TESTS=all && cmake --build --preset default --target times_test; } \
  >"$log" 2>&1 || { tail -n 30 "$log" >&2; exit 2; }
PALPATE_LOAD_SECONDS=$seconds exec build/tests/times_test --gtest_filter='LoadTest.Many*'
