#!/usr/bin/env python3
"""count_cases.py JUNIT_XML: how many cases a run of ctest ran, and how many of them were skipped.

One test of ctest's may be a whole program of GoogleTest or a file of Python: their own counts are
read from what they printed. A test that prints none is one case."""

import re
import sys
import xml.etree.ElementTree


def cases(test):
    """(cases, skipped) of one <testcase>."""
    said = test.findtext("system-out") or ""
    ran = re.search(r"^\[=+\] Running (\d+) tests? from", said, re.MULTILINE)
    if ran:
        skipped = re.search(r"^\[  SKIPPED \] (\d+) tests?, listed below", said, re.MULTILINE)
        return int(ran[1]), int(skipped[1]) if skipped else 0
    ran = re.search(r"^Ran (\d+) tests? in ", said, re.MULTILINE)
    if ran:
        skipped = re.search(r"^(?:OK|FAILED) \(.*\bskipped=(\d+)", said, re.MULTILINE)
        return int(ran[1]), int(skipped[1]) if skipped else 0
    return 1, 0 if test.get("status") in ("run", "fail") else 1


def main():
    tests = xml.etree.ElementTree.parse(sys.argv[1]).iter("testcase")
    print(*(sum(column) for column in zip((0, 0), *map(cases, tests))))


if __name__ == "__main__":
    main()
