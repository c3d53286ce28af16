#!/usr/bin/env python3
"""await_processors.py SECONDS: waits until this virtual machine gets its processors, for SECONDS
at most, and prints how many seconds it waited.

A host that gives them to others stops all clocks of the tests at once. The kernel counts that
time (steal in /proc/stat), but only while there is work: so they are kept busy for a moment."""

import os
import sys
import time

BUSY_S, PAUSE_S = 2.0, 20.0
MOST_STOLEN = 0.1


def spin():
    end = time.monotonic() + BUSY_S
    while time.monotonic() < end:
        pass
    os._exit(0)


def times():
    """(stolen, all) of all processors since the start, in the kernel's ticks."""
    with open("/proc/stat", encoding="ascii") as stat:
        fields = [int(word) for word in stat.readline().split()[1:9]]
    return fields[7], sum(fields)


def stolen_share():
    before = times()
    children = []
    for _ in range(os.cpu_count() or 1):
        child = os.fork()
        if child == 0:
            spin()
        children.append(child)
    for child in children:
        os.waitpid(child, 0)
    after = times()
    return (after[0] - before[0]) / max(1, after[1] - before[1])


def main():
    patience_s = float(sys.argv[1])
    began = time.monotonic()
    while patience_s > 0.0:
        share = stolen_share()
        waited_s = time.monotonic() - began
        if share <= MOST_STOLEN or waited_s >= patience_s:
            break
        print(f"run.sh: others take {100.0 * share:.0f} % of this machine's processors: waiting, "
              f"{patience_s - waited_s:.0f} s at most", file=sys.stderr)
        time.sleep(min(PAUSE_S, patience_s - waited_s))
    print(round(time.monotonic() - began))


if __name__ == "__main__":
    main()
