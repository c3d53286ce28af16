#!/usr/bin/env bash
# Demonstrates Palpate on one machine: builds missing programs, starts palpated with the
# simulated device, and watches it, in this terminal or in a browser.
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
  local code=$? process
  for process in $watcher $daemon; do
    kill -TERM "$process" 2>/dev/null || true
    wait "$process" 2>/dev/null || true
  done
  [ -z "$work" ] || rm -rf "$work"
  [ -z "$interrupted" ] || code=0
  exit "$code"
}
trap on_signal INT TERM HUP
trap stop_all EXIT

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

usage() {
  cat <<'TEXT'
Usage: deploy/demo.sh [--volume FILE] [--isovalue X | --normalized-isovalue X] [--layers LIST]
                      [--seconds N] [--web [--web-port N]]

Installs missing packages (Debian 12, as root or a sudo user), builds its programs into
build/ (some minutes the first time), starts palpated with the simulated device, and runs
`palpate watch`. Ctrl-C, or the end of N seconds, stops everything.

  --volume FILE            NRRD, MetaImage, NIfTI, VDB file, DICOM folder, or
                           builtin:cylinder|sphere|bumps|gyroid[:N] [builtin:bumps]
  --isovalue X             isovalue in the volume's data units
  --normalized-isovalue X  isovalue over the volume's range, 0 to 1 [one that shows something]
  --layers LIST            surfaces one behind the other, NAME=ISOVALUE,...: skin=-300,bone=300
  --seconds N              stop after N seconds [until Ctrl-C]
  --web                    show it in a browser on this machine instead of `palpate watch`:
                           also starts palpate-web, and prints the link
  --web-port N             port of the link [7480, or the next free one]
TEXT
}

daemon_arguments=()
seconds=
web=
web_port=
layers=
volume=builtin:bumps
while [ $# -gt 0 ]; do
  case "$1" in
    -h | --help) usage; exit 0 ;;
    --web) web=yes; shift ;;
    --volume | --isovalue | --normalized-isovalue | --layers | --seconds | --web-port)
      [ $# -ge 2 ] || { echo "demo: $1 needs a value (see --help)" >&2; exit 2; }
      case "$1" in
        --seconds) seconds=$2 ;;
        --layers) layers=$2 ;;
        --web-port) web=yes web_port=$2 ;;
        --volume) volume=$2 daemon_arguments+=("$1" "$2") ;;
        *) daemon_arguments+=("$1" "$2") ;;
      esac
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
if [ -n "$web" ]; then
  sections+=(web page)
  targets+=(palpate-web palpate_web_page)
  options+=(-DPALPATE_WEB=ON -DPALPATE_WEB_PAGE=ON)
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

# free_port FIRST: prints the first port from there on that nobody listens to on loopback
free_port() {
  local port=$1
  while (: <>"/dev/tcp/127.0.0.1/$port") 2>/dev/null; do port=$((port + 1)); done
  echo "$port"
}

work=$(mktemp -d "${TMPDIR:-/tmp}/palpate-demo.XXXXXX")
socket=$work/palpated.sock
bin=$root/build/bin
# Programs run in their own sessions, so Ctrl-C reaches only this script. The script ends what
# watches first and then the daemon. All also end when the script is killed.
apart=(setsid setpriv --pdeathsig TERM)
if [ -n "$web" ]; then
  # On loopback palpate-web may only watch; on the socket it could do everything.
  port=$(free_port 7400)
  # The link stays the last line.
  daemon_arguments+=(--listen "127.0.0.1:$port" --log-level warning)
fi
"${apart[@]}" "$bin/palpated" --socket "$socket" ${daemon_arguments[@]+"${daemon_arguments[@]}"} &
daemon=$!
echo "in another terminal: $bin/palpate info --socket $socket"
if [ -n "$layers" ] && ! "$bin/palpate" layers "$layers" --socket "$socket"; then
  [ -n "$interrupted" ] || exit 2
fi
if [ -z "$web" ]; then
  "${apart[@]}" "$bin/palpate" watch --socket "$socket" ${seconds:+--seconds "$seconds"} &
  watcher=$!
# `palpate info` waits for the volume.
elif "$bin/palpate" info --socket "$socket" >/dev/null 2>&1 && [ -z "$interrupted" ]; then
  mkfifo "$work/link"
  "${apart[@]}" ${seconds:+timeout --preserve-status "$seconds"} "$bin/palpate-web" \
    --server "127.0.0.1:$port" --listen "127.0.0.1:${web_port:-$(free_port 7480)}" \
    --page "$root/build/web" >"$work/link" &
  watcher=$!
  # When it is ready, it prints the link.
  exec 3<"$work/link"
  if read -r link <&3; then
    printf '%s\n' "Ctrl-C stops everything. In a browser on this machine:" "$link"
  fi
fi
[ -z "$interrupted" ] || exit 0
code=0
# `palpate watch` ends when the daemon has ended; palpate-web would wait for the next daemon.
wait -n ${watcher:+"$watcher"} ${web:+"$daemon"} || code=$?
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
