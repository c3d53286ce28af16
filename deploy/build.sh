#!/usr/bin/env bash
# build.sh FOLDER TARGET...: builds these targets in a configured build folder, and reports the
# progress. On a terminal, it rewrites one line; elsewhere, it writes a line every ten seconds.
# If the build fails, it shows the compiler's messages.
set -euo pipefail
folder=$1
shift

report() {
  local log=$1 started=$SECONDS shown=-10 line done all left text
  while IFS= read -r line; do
    if [[ "$line" =~ ^\[([0-9]+)/([0-9]+)\] ]]; then
      done=${BASH_REMATCH[1]} all=${BASH_REMATCH[2]}
      [ "$done" -gt 0 ] || continue
      left=$(((SECONDS - started) * (all - done) / done))
      text="built $done of $all"
      if [ "$done" -eq "$all" ]; then :
      elif [ "$left" -ge 90 ]; then text+=", about $(((left + 30) / 60)) min left"
      elif [ $((SECONDS - started)) -ge 10 ]; then text+=", about a minute left"; fi
      if [ -t 1 ]; then
        printf '\r%-50s' "$text"
      elif [ $((SECONDS - shown)) -ge 10 ]; then
        shown=$SECONDS
        echo "$text"
      fi
    fi
    echo "$line" >>"$log"
  done
  if [ -t 1 ]; then printf '\r%-50s\r' ''; fi
}

log=$(mktemp)
trap 'rm -f "$log"' EXIT
# The pipe makes ninja write a line for each step, also on a terminal.
if ! NINJA_STATUS='[%f/%t] ' ninja -C "$folder" "$@" 2>&1 | report "$log"; then
  grep -vE '^\[[0-9]+/[0-9]+\]|^ninja: Entering' "$log" | tail -n 60 >&2
  echo "build.sh: the build failed, see above" >&2
  exit 1
fi
