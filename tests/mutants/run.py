#!/usr/bin/env python3
"""Changes one line of Palpate at a time, and shows that a test notices.

Each change of mutants.toml is applied to a copy of the tree. The test program that is named for
it is built and run, or the file of Python tests. A change is caught when that program fails,
crashes or hangs. The unchanged tree has to pass the same tests first: a test that always fails
catches nothing.

Exit status: 0 when all are caught; 1 when one survives, no longer applies or does not compile,
or when the unchanged tree fails.
"""

import argparse
import contextlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
# A test that takes this many times as long as on the unchanged tree, and this long, hangs.
PATIENCE_FACTOR = 10
PATIENCE_S = 120


def read_list(path):
    """The changes, in the order of the file. A fault of the file ends the program."""
    changes = tomllib.loads(path.read_text())["mutant"]
    names = [change["name"] for change in changes]
    if len(set(names)) != len(names):
        sys.exit(f"{path}: a name is there twice")
    for change in changes:
        missing = {"name", "why", "file", "from", "to", "program", "tests"} - change.keys()
        if missing:
            sys.exit(f"{path}: {change['name']} lacks {', '.join(sorted(missing))}")
        if "\n" in change["from"].strip() or "\n" in change["to"].strip():
            sys.exit(f"{path}: {change['name']} is more than one line")
    return changes


def copy_tree(target):
    """What git knows of, and what is new and not ignored. Files that are equal keep their
    time, so that a folder that is used again builds what changed."""
    listed = subprocess.run(["git", "ls-files", "-z", "--cached", "--others",
                             "--exclude-standard"], cwd=ROOT, check=True, capture_output=True,
                            text=True).stdout.split("\0")
    wanted = {name for name in listed if name and (ROOT / name).is_file()}
    for name in wanted:
        source, copy = ROOT / name, target / name
        if copy.exists() and copy.read_bytes() == source.read_bytes():
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, copy)
        shutil.copymode(source, copy)
    for copy in target.rglob("*"):
        name = copy.relative_to(target)
        if copy.is_file() and name.parts[0] != "build" and str(name) not in wanted:
            copy.unlink()


def is_python(program):
    return program.startswith(("python_", "daemon_"))


def targets_of(program):
    """What is built to run it."""
    return ["palpate", "palpate_python", "palpated", "palpate-import"] if is_python(program) else [program]


class Tree:
    """The copy and its build folder."""

    def __init__(self, folder, jobs):
        self.folder = folder
        self.jobs = jobs
        folder.mkdir(parents=True, exist_ok=True)
        copy_tree(folder)
        data = os.environ.get("PALPATE_DATA_DIR", ROOT.parent / "shared" / "data")
        self._call(["cmake", "--preset", "default", f"-DPALPATE_DATA_DIR={data}"], "configure")

    def _call(self, command, what):
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{what} failed:\n" + (done.stdout + done.stderr)[-3000:])

    def build(self, programs):
        programs = sorted({target for program in programs for target in targets_of(program)})
        self._call(["nice", "ninja", "-C", "build", f"-j{self.jobs}", *programs], "the build")

    def test(self, program, tests, patience_s):
        """How many tests ran, and which failed; `hangs` or `crashes` is a failure too."""
        if is_python(program):
            command = ["ctest", "--test-dir", "build", "--tests-regex", f"^{program}", "--verbose"]
        else:
            command = [f"build/tests/{program}", f"--gtest_filter={tests}"]
        try:
            # The core file of a crash would be of no use.
            done = subprocess.run(
                ["sh", "-c", 'ulimit -c 0; exec "$@"', "sh", *command],
                cwd=self.folder, capture_output=True, text=True, errors="replace",
                timeout=patience_s)
        except subprocess.TimeoutExpired:
            return 0, ["hangs"]
        if is_python(program):
            failed = sorted(set(re.findall(r"^\d+: (?:FAIL|ERROR): (\w+)", done.stdout, re.M)))
            ran = sum(map(int, re.findall(r"^\d+: Ran (\d+) tests? in", done.stdout, re.M)))
            return ran, failed or ([f"ends with {done.returncode}"] if done.returncode else [])
        failed = sorted(set(re.findall(r"^\[  FAILED  \] (\w+[./]\S+?),? ", done.stdout, re.M)))
        if done.returncode != 0 and not failed:
            failed = [f"crashes with {done.returncode}"]
        passed = re.search(r"^\[  PASSED  \] (\d+) test", done.stdout, re.M)
        return (int(passed[1]) if passed else 0) + len(failed), failed

    @contextlib.contextmanager
    def changed(self, change):
        path = self.folder / change["file"]
        original = path.read_text()
        times = original.count(change["from"])
        if times != 1:
            raise RuntimeError(f"no longer applies: {change['file']} has its line {times} times")
        path.write_text(original.replace(change["from"], change["to"]))
        try:
            yield
        finally:
            path.write_text(original)


def check_unchanged(tree, changes):
    """Seconds that each group of tests takes; none where one fails."""
    groups = {(change["program"], change["tests"]) for change in changes}
    programs = sorted({program for program, _ in groups})
    print(f"building {len(programs)} test programs of the unchanged tree", flush=True)
    tree.build(programs)
    seconds = {}
    for program, tests in sorted(groups):
        began = time.monotonic()
        ran, failed = tree.test(program, tests, 3600)
        seconds[program, tests] = time.monotonic() - began
        if failed or ran == 0:
            print(f"unchanged: {program} {tests}: {', '.join(failed) or 'no such test'}")
            return None
        print(f"unchanged: {program}: {ran} pass", flush=True)
    return seconds


def try_change(tree, change, seconds):
    """Whether it is caught, and a line about it."""
    usual_s = seconds[change["program"], change["tests"]]
    try:
        with tree.changed(change):
            tree.build([change["program"]])
            _, failed = tree.test(change["program"], change["tests"],
                                  max(PATIENCE_S, PATIENCE_FACTOR * usual_s))
    except RuntimeError as error:
        return False, f"{change['name']}: {error}"
    if failed:
        return True, f"{change['name']}: caught by {', '.join(failed[:3])}"
    return False, f"{change['name']}: SURVIVED {change['program']} ({change['why']})"


def list_changes(changes):
    gone = 0
    for change in changes:
        applies = (ROOT / change["file"]).read_text().count(change["from"]) == 1
        gone += not applies
        print(f"{change['name']}: {change['why']}\n    {change['file']}: {change['program']} "
              f"{change['tests']}" + ("" if applies else "\n    NO LONGER APPLIES"))
    return 1 if gone else 0


def main():
    here = pathlib.Path(__file__).parent
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="NAME", action="append",
                        help="this change alone; may be given again")
    parser.add_argument("--list", action="store_true",
                        help="print the changes, and whether each still applies")
    parser.add_argument("--work", metavar="FOLDER", type=pathlib.Path,
                        help="keep the copy and its build here, for the next run; "
                             "otherwise a temporary folder")
    parser.add_argument("--jobs", metavar="N", type=int, default=os.cpu_count(),
                        help="compilers at a time (default: one per processor)")
    parser.add_argument("--mutants", metavar="FILE", type=pathlib.Path,
                        default=here / "mutants.toml", help="the changes (default: %(default)s)")
    arguments = parser.parse_args()
    changes = read_list(arguments.mutants)
    unknown = set(arguments.only or []) - {change["name"] for change in changes}
    if unknown:
        parser.error(f"no change is called {', '.join(sorted(unknown))}; see --list")
    if arguments.only:
        changes = [change for change in changes if change["name"] in arguments.only]
    if arguments.list:
        return list_changes(changes)
    with contextlib.ExitStack() as stack:
        folder = arguments.work or pathlib.Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="palpate-mutants-")))
        try:
            tree = Tree(folder.resolve() / "tree", arguments.jobs)
            seconds = check_unchanged(tree, changes)
        except RuntimeError as error:
            print(f"unchanged: {error}")
            return 1
        if seconds is None:
            return 1
        missed = []
        for number, change in enumerate(changes, 1):
            caught, line = try_change(tree, change, seconds)
            print(f"[{number}/{len(changes)}] {line}", flush=True)
            if not caught:
                missed.append(change["name"])
    print(f"{len(changes) - len(missed)} of {len(changes)} caught"
          + (f"; not: {', '.join(missed)}" if missed else ""))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
