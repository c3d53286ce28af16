#!/usr/bin/env bash
# Draws the figures of deploy/guides/method.md again, with palpate-lab.
#
# Usage: deploy/guides/method_figures.sh FOLDER
#
# Takes palpate-lab from PATH, or else from build/bin.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
folder=${1:?"name the folder for the figures"}
lab=$(command -v palpate-lab || echo "$root/build/bin/palpate-lab")
work=$(mktemp -d "${TMPDIR:-/tmp}/palpate-figures.XXXXXX")
trap 'rm -rf "$work"' EXIT

# figure NAME: moves the figure that palpate-lab wrote last to FOLDER/NAME, rounded to a tenth of
# a pixel. The eye sees no difference, and the file is a third smaller. Numbers of texts end before
# a `<` and stay.
figure() {
  sed -E 's/([0-9]+\.[0-9])[0-9]+([^0-9<])/\1\2/g' "$work"/*.svg >"$folder/$1"
  rm "$work"/*.svg
}

mkdir -p "$folder"

# Cells whose topology the published rules change. Each row: name, isovalue, d0 to d7; the other
# columns of the paper's table are empty.
cat >"$work/wrong.csv" <<'CELLS'
3 saddles,0.48,0.91,0.25,0.24,0.80,0.90,0.23,0.73,0.32,,,,,
4 saddles,0.40,0.93,0.14,0.82,0.71,0.18,0.44,0.03,0.51,,,,,
6 saddles,0.21,0.01,0.88,0.45,0.55,0.85,0.41,0.58,0.41,,,,,
CELLS
"$lab" experiment figure11 --table "$work/wrong.csv" --out "$work" --overwrite >"$work/log"
figure method-wrong-cells.svg

# Three cells of the paper's Table 4.
grep -E '^(3\.2|7\.4\.2|14),' "$root/tests/data/cells/table4.csv" >"$work/table4.csv"
"$lab" experiment figure11 --table "$work/table4.csv" --out "$work" --overwrite >"$work/log"
figure method-cells.svg

"$lab" experiment diamond --cells 1 --out "$work" --overwrite >"$work/log"
figure method-diamond.svg

"$lab" experiment figure9 --out "$work" --overwrite >"$work/log"
figure method-drift.svg
