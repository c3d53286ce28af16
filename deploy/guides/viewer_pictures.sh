#!/usr/bin/env bash
# Takes the README's pictures of the viewer from real runs. For each picture, it runs palpated
# with the simulated device, and palpate-view without a window.
#
# Usage: deploy/guides/viewer_pictures.sh FOLDER [NAME...]
#
# Reads volumes from PALPATE_DATA_DIR (default: ../shared/data) and programs from build/bin.
# NAME: lobster, head, daisy, gyroid, window; default: all.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
data=${PALPATE_DATA_DIR:-$root/../shared/data}/paper
folder=${1:?"name the folder for the pictures"}
shift
names=("$@")
[ ${#names[@]} -gt 0 ] || names=(lobster head daisy gyroid window)
work=$(mktemp -d "${TMPDIR:-/tmp}/palpate-pictures.XXXXXX")
daemon=
stop_daemon() {
  [ -z "$daemon" ] || { kill "$daemon" 2>/dev/null || true; wait "$daemon" || true; }
  daemon=
}
trap 'stop_daemon; rm -rf "$work"' EXIT

# picture NAME VOLUME NORMALIZED_ISOVALUE VIEW_ARGUMENTS...
picture() {
  local name=$1 volume=$2 isovalue=$3
  shift 3
  : >"$work/log"  # of the last picture
  "$root/build/bin/palpated" --volume "$volume" --normalized-isovalue "$isovalue" \
    --socket "$work/palpated.sock" --state-folder "$work/state" >"$work/log" 2>&1 &
  daemon=$!
  until grep -q 'ready on' "$work/log"; do
    kill -0 "$daemon" 2>/dev/null || { cat "$work/log" >&2; exit 1; }
    sleep 0.1
  done
  "$root/build/bin/palpate-view" --socket "$work/palpated.sock" --offscreen --wait-contact \
    --screenshot "$folder/$name.png" --overwrite "$@"
  stop_daemon
}

mkdir -p "$folder"
for name in "${names[@]}"; do
  case "$name" in
    lobster)
      picture view-lobster "$data/lobster_301x324x56_uint8.nhdr" 0.16 \
        --size 960x640 --color 205,92,66 --camera 25,35,150 --no-box ;;
    head)
      # Skin at -342 HU, as the stylus feels it; bone at 300 HU, with the skin as a veil.
      picture view-head-skin "$data/SUBST_head_ct_cranium_256x256x108_int16.nrrd" 0.17 \
        --size 640x640 --camera 168,60,190 --no-box --crop 0.2,0.82,0.09,1,0,1 --color 226,178,150
      picture view-head-bone "$data/SUBST_head_ct_cranium_256x256x108_int16.nrrd" 0.33 \
        --size 640x640 --camera 168,60,190 --no-box --crop 0.2,0.82,0.09,1,0,1 --veil=-342,0.25 ;;
    daisy)
      picture view-daisy "$data/daisy_192x180x168_uint8.nhdr" 0.24 \
        --size 960x640 --camera -25,20,105 --no-box --coloring slope --color-map viridis ;;
    gyroid)
      picture view-gyroid builtin:gyroid:16 0.5 --size 960x640 --wait-gap 0.15 --no-stylus \
        --haptic-surface --haptic-surface-radius 3 --camera profile,6 --no-box ;;
    window)
      # Without letters: the file does not say how the patient lay.
      picture view-window "$data/SUBST_head_ct_cranium_256x256x108_int16.nrrd" 0.33 \
        --size 1280x800 --panels --camera 168,60,260 --crop 0.2,0.82,0.09,1,0,1 --veil=-342,0.2 --haptic-surface --no-letters ;;
    *) echo "viewer_pictures.sh: no picture is called $name" >&2; exit 2 ;;
  esac
done
