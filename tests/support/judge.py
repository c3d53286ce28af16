#!/usr/bin/env python3
"""judge.py JUNIT_XML LOG STOLEN: which failures of a run of ctest a busy machine may explain.

They go to stdout as "number:name", as in ctest's LastTestsFailed.log. To stderr go all others, with
the reason and all that they printed, and of the excusable ones what failed. A failure is excused only if the test ended by itself, with an exit status, and said at
its end that every failed assertion may be excused (test_main.cpp, run_tests.py). LOG is what
ctest printed: the XML does not tell a crash or a timeout from a failure. STOLEN is the percentage
of the processors' time that the machine's host gave to others meanwhile."""

import re
import sys
import xml.etree.ElementTree

# More is a bug, unless the host took the processors.
MOST = 10
MUCH_STOLEN = 10
HEADLINE = "The following tests FAILED:"
LINE = re.compile(r"\s*(\d+) - (.*) \(([^()]*)\)\s*$")
SANITIZER = re.compile(r"Sanitizer:|runtime error:")
# As excuse.h and excuse.py have it, and enough lines to see the assertion that carries it.
MARK = re.compile(r"\[a busy machine may explain this\]|\bBusyMachine\b")
LINES_BEFORE_MARK = 4
# ctest drops what comes after so many bytes.
CUT = "This part of the test output was removed"


def failures(log):
    """(number, name, how it ended) of each."""
    _, found, end = log.rpartition(HEADLINE)
    return [match.groups() for match in map(LINE.match, end.splitlines() if found else []) if match]


def outputs(xml_file):
    return {case.get("name"): case.findtext("system-out") or ""
            for case in xml.etree.ElementTree.parse(xml_file).iter("testcase")}


def why_final(end, output):
    """Empty: a busy machine may explain it."""
    if end != "Failed":
        return end
    if SANITIZER.search(output):
        return "a sanitizer found something"
    if CUT in output:
        return "its output is cut"
    if not re.search(r"^\*\*\*Excusable ", output, re.MULTILINE):
        return "not all of it is excusable"
    return ""


def marked(output):
    """The assertions that carry the mark."""
    lines = output.splitlines()
    return ["\n".join(lines[max(0, at - LINES_BEFORE_MARK):at + 1])
            for at, line in enumerate(lines) if MARK.search(line)]


def judge(said, log, stolen):
    """(number, name) of what may be run again; (name, reason) of what may not."""
    again, final = [], []
    for number, name, end in failures(log):
        why = why_final(end, said.get(name, ""))
        if why:
            final.append((name, why))
        else:
            again.append((number, name))
    if len(again) > MOST and stolen < MUCH_STOLEN:
        return [], final + [(name, f"more than {MOST} would be excused") for _, name in again]
    return again, final


def main():
    xml_file, log_file, stolen = sys.argv[1:]
    said = outputs(xml_file)
    with open(log_file, encoding="utf-8", errors="replace") as log:
        again, final = judge(said, log.read(), float(stolen))
    for name, why in final:
        print(said.get(name, ""), f"run.sh: not excused: {name}: {why}", sep="\n", file=sys.stderr)
    for number, name in again:
        print(f"run.sh: may be excused: {name}:", *marked(said[name]), sep="\n", file=sys.stderr)
        print(f"{number}:{name}")


if __name__ == "__main__":
    main()
