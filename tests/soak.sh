#!/usr/bin/env bash
# Everything at once for an hour, or for --seconds N: memory and open files must stay
# what they were, and the proxy outside of the material. Ends with figures and a verdict.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
case "${1:-}" in
  -h | --help)
    echo "Usage: tests/soak.sh [--seconds N]"
    exit 0
    ;;
  "") set -- --seconds 3600 ;;
esac
cd "$root"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
{ cmake --preset default && cmake --build --preset default --target palpated palpate_python; } \
  >"$log" 2>&1 || { tail -n 30 "$log" >&2; exit 2; }
export PALPATED=$root/build/bin/palpated PYTHONPATH=$root/build/python:$root/tests/support PYTHONDONTWRITEBYTECODE=1
exec /usr/bin/python3 tests/operations/soak.py "$@"
