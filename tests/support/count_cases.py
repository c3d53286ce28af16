#!/usr/bin/env python3
"""count_cases.py JUNIT_XML: how many cases a run of ctest ran, how many of them were skipped, and
how many failed.

One test of ctest's may be a whole program of GoogleTest, a file of Python or one of Node: their own
counts are read from what they printed. A test that prints none is one case."""

import re
import sys
import xml.etree.ElementTree


def cases(test):
    """(cases, skipped, failed) of one <testcase>."""
    said = test.findtext("system-out") or ""

    def lines(pattern):
        return len(re.findall(pattern, said, re.MULTILINE))

    skip = test.find("skipped")
    # The file calls a test skipped, too, whose program is missing.
    is_skipped = skip is not None and skip.get("message", "").startswith("SKIP_")
    has_failed = not is_skipped and test.get("status") != "run"
    ran = re.search(r"^\[=+\] Running (\d+) tests? from", said, re.MULTILINE)
    if ran:
        # One that crashes has no last lines.
        skipped = lines(r"^\[  SKIPPED \] .* \(\d+ ms\)$")
        failed = int(ran[1]) - skipped - lines(r"^\[       OK \] ")
    elif ran := re.search(r"^Ran (\d+) tests? in ", said, re.MULTILINE):
        skipped, failures, errors = (
            sum(map(int, re.findall(rf"^(?:OK|FAILED) \(.*\b{name}=(\d+)", said, re.MULTILINE)))
            for name in ("skipped", "failures", "errors"))
        failed = failures + errors
    elif ran := re.search(r"^# tests (\d+)$", said, re.MULTILINE):
        skipped, failed = (sum(map(int, re.findall(rf"^# {name} (\d+)$", said, re.MULTILINE)))
                           for name in ("skipped", "fail"))
    else:
        return 1, int(is_skipped), int(has_failed)
    # A test may fail at its end although none of its cases does; a case of Python's may fail more
    # than once, or before it has run.
    failed = max(failed, 1) if has_failed else 0
    return max(int(ran[1]), skipped + failed), skipped, failed


def main():
    tests = xml.etree.ElementTree.parse(sys.argv[1]).iter("testcase")
    print(*(sum(column) for column in zip((0, 0, 0), *map(cases, tests))))


if __name__ == "__main__":
    main()
