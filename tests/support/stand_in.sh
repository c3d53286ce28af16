#!/bin/sh
# Stands in for palpated where the tests themselves are tested: says that it is ready, and does at
# SIGTERM what PALPATE_STAND_IN names.
case "$PALPATE_STAND_IN" in
  order) trap 'exit 0' TERM ;;
  abort) trap 'kill -ABRT $$' TERM ;;
  hang) trap '' TERM ;;
  leak) trap 'echo "ERROR: LeakSanitizer: detected memory leaks" >&2; exit 0' TERM ;;
  fail) trap 'exit 3' TERM ;;
  *) exit 2 ;;
esac
echo "ready on nothing" >&2
while :; do sleep 0.1; done
