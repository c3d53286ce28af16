#!/usr/bin/env bash
# Demonstrates Palpate on one machine: builds missing programs, starts palpated with the
# simulated device, and watches it.
set -euo pipefail
# Set at the start, so that Ctrl-C ends the demo cleanly at any moment.
interrupted=
watcher=
daemon=
work=
on_signal() {
  interrupted=yes
  [ -z "$watcher" ] || kill -INT "$watcher" 2>/dev/null || true
}
stop_all() {
  local code=$?
  if [ -n "$daemon" ]; then
    kill -TERM "$daemon" 2>/dev/null || true
    wait "$daemon" 2>/dev/null || true
  fi
  [ -z "$work" ] || rm -rf "$work"
  [ -z "$interrupted" ] || code=0
  exit "$code"
}
trap on_signal INT TERM HUP
trap stop_all EXIT

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

usage() {
  cat <<'TEXT'
Usage: deploy/demo.sh [--volume FILE] [--isovalue X | --normalized-isovalue X] [--seconds N]

Installs missing packages (Debian 12, as root or a sudo user), builds its programs into
build/ (some minutes the first time), starts palpated with the simulated device, and runs
`palpate watch`. Ctrl-C, or the end of N seconds, stops everything.

  --volume FILE            NRRD, MetaImage, NIfTI, VDB file, DICOM folder, or
                           builtin:cylinder|sphere|bumps|gyroid[:N] [builtin:bumps]
  --isovalue X             isovalue in the volume's data units
  --normalized-isovalue X  isovalue over the volume's range, 0 to 1 [one that shows something]
  --seconds N              stop after N seconds [until Ctrl-C]
TEXT
}

daemon_arguments=()
watch_arguments=()
volume=builtin:bumps
while [ $# -gt 0 ]; do
  case "$1" in
    -h | --help) usage; exit 0 ;;
    --volume | --isovalue | --normalized-isovalue | --seconds)
      [ $# -ge 2 ] || { echo "demo: $1 needs a value (see --help)" >&2; exit 2; }
      [ "$1" != --volume ] || volume=$2
      if [ "$1" = --seconds ]; then watch_arguments+=("$1" "$2"); else daemon_arguments+=("$1" "$2"); fi
      shift 2 ;;
    *) echo "demo: unknown argument $1 (see --help)" >&2; exit 2 ;;
  esac
done

# Builds only the programs that the demo runs. Only files need the importer.
sections=(demo)
targets=(palpated palpate)
options=(-DPALPATE_EVERYTHING=OFF)
if [[ "$volume" != builtin:* ]]; then
  sections+=(import)
  targets+=(palpate-import)
  options+=(-DPALPATE_IMPORT=ON)
fi
"$root/deploy/install-packages.sh" "${sections[@]}"
[ -z "$interrupted" ] || exit 0
# No cd: the volume's path is relative to the user's folder.
if ! ninja -C "$root/build" -t query "${targets[@]}" >/dev/null 2>&1; then
  echo "configuring"
  (cd "$root" && cmake --preset default "${options[@]}" >/dev/null)
fi
"$root/deploy/build.sh" "$root/build" "${targets[@]}"
[ -z "$interrupted" ] || exit 0

work=$(mktemp -d "${TMPDIR:-/tmp}/palpate-demo.XXXXXX")
socket=$work/palpated.sock
# Both programs run in their own sessions, so Ctrl-C reaches only this script. The script
# ends the watch first and then the daemon. Both also end when the script is killed.
setsid setpriv --pdeathsig TERM "$root/build/bin/palpated" --socket "$socket" \
  ${daemon_arguments[@]+"${daemon_arguments[@]}"} &
daemon=$!
echo "in another terminal: $root/build/bin/palpate info --socket $socket"
code=0
setsid setpriv --pdeathsig TERM "$root/build/bin/palpate" watch --socket "$socket" ${watch_arguments[@]+"${watch_arguments[@]}"} &
watcher=$!
wait "$watcher" || code=$?
if [ -n "$interrupted" ]; then
  # The trap interrupted the first wait.
  wait "$watcher" 2>/dev/null || true
fi
# A daemon that failed has said why.
if [ "$code" -ne 0 ] && ! kill -0 "$daemon" 2>/dev/null; then
  code=0
  wait "$daemon" || code=$?
  daemon=
fi
exit "$code"
