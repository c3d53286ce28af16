#!/usr/bin/env bash
# repeat.sh [N]: runs tests/run.sh N times (10) on a machine that builds something else at the same
# time, and counts what was excused. Fails if a run fails, or if one test was excused in more
# than one of ten runs: that is a bug of the test.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
case "${1:-10}" in
  -h | --help) sed -n '2,4s/^# //p' "$0"; exit 0 ;;
  *[!0-9]* | 0) echo "repeat.sh: $1 is no number of runs (see --help)" >&2; exit 2 ;;
esac
runs=${1:-10}
work=$(mktemp -d)
end() {
  kill -- "-$beside" 2>/dev/null || true
  rm -rf "$work"
}
trap end EXIT

# A build of the same tree in a folder of its own, again and again, without ccache.
build_beside() {
  cmake --preset default -B "$work/build" >"$work/build.log" 2>&1
  while :; do
    CCACHE_DISABLE=1 nice ninja -C "$work/build" -j1 palpated >>"$work/build.log" 2>&1
    ninja -C "$work/build" -t clean >>"$work/build.log" 2>&1
  done
}
cd "$root"
set -m
build_beside &
beside=$!
set +m

failed=0
for ((run = 1; run <= runs; ++run)); do
  tests/run.sh >"$work/run-$run.log" 2>&1 || failed=$((failed + 1))
  printf 'run %d of %d: %s\n' "$run" "$runs" "$(tail -n 1 "$work/run-$run.log")"
  grep -E '^(excused by a busy machine|failed|run\.sh):' "$work/run-$run.log" || true
done
excuses=$(grep -h '^excused by a busy machine' "$work"/run-*.log | sort | uniq -c | sort -rn || true)
[ -z "$excuses" ] || printf 'excused, and in how many runs:\n%s\n' "$excuses"
often=$(awk -v most=$(((runs + 9) / 10)) '$1 > most' <<<"$excuses")
[ -z "$often" ] || echo "repeat.sh: excused in more than one of ten runs: a bug" >&2
echo "$runs runs, $failed failed"
[ "$failed" -eq 0 ] && [ -z "$often" ]
