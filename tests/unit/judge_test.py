"""Which failures are run again: tests/run.sh, tests/support/judge.py, run_tests.py, excuse.py."""

import contextlib
import io
import os
import pathlib
import subprocess
import sys
import tempfile
import textwrap
import unittest
import unittest.mock
import xml.etree.ElementTree
from xml.sax.saxutils import escape

SUPPORT = pathlib.Path(__file__).parents[1] / "support"
sys.path.insert(0, str(SUPPORT))
import await_processors  # noqa: E402
import count_cases  # noqa: E402
import judge  # noqa: E402


class Judge(unittest.TestCase):
    def judged(self, *cases, stolen=0):
        """cases: (name, how ctest says that it ended, output). (again, final)"""
        with tempfile.TemporaryDirectory() as folder:
            xml, log = pathlib.Path(folder, "a.xml"), pathlib.Path(folder, "a.log")
            xml.write_text("<testsuite>" + "".join(
                f'<testcase name="{escape(name)}" status="fail"><failure message=""/>'
                f"<system-out>{escape(output)}</system-out></testcase>"
                for name, _, output in cases) + "</testsuite>")
            log.write_text("1/9 Test #1: a ...***Failed\n\nThe following tests FAILED:\n" + "".join(
                f"\t{number:3d} - {name} ({end})\n" for number, (name, end, _) in enumerate(cases)))
            said, complaints = io.StringIO(), io.StringIO()
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complaints):
                sys.argv[1:] = [str(xml), str(log), str(stolen)]
                judge.main()
            self.complaints = complaints.getvalue()
            return said.getvalue().splitlines(), [
                line for line in self.complaints.splitlines() if "not excused" in line]

    def test_an_excuse_counts_only_with_an_exit_status(self):
        said = "[  FAILED  ] A.B\n***Excusable A.B\n"
        self.assertEqual(self.judged(("integration.A.B", "Failed", said)),
                         (["0:integration.A.B"], []))
        for end in ("SEGFAULT", "Subprocess aborted", "Subprocess killed", "Timeout", "Not Run",
                    "ILLEGAL", "NUMERICAL", "OTHER_FAULT"):
            again, final = self.judged(("integration.A.B", end, said))
            self.assertEqual((again, len(final)), ([], 1), end)
            self.assertIn(end, final[0])

    def test_a_failure_without_excuse_is_final(self):
        for output in ("", "[  FAILED  ] A.B\n", "value: ***Excusable A.B\n"):
            self.assertEqual(self.judged(("a", "Failed", output))[0], [], output)

    def test_what_failed_is_shown(self):
        output = "\n".join(["boring"] * 9 + ["it_test.cpp:7: Failure", "3 vs 4", "[a busy machine may explain this]"])
        self.judged(("a", "Failed", f"{output}\n***Excusable A.B\n"))
        self.assertIn("it_test.cpp:7: Failure\n3 vs 4\n[a busy", self.complaints)
        self.assertLess(self.complaints.count("boring"), 4)
        self.judged(("a", "Failed", output))
        self.assertIn(output, self.complaints)

    def test_a_sanitizer_is_never_excused(self):
        for line in ("==7==ERROR: LeakSanitizer: detected memory leaks",
                     "WARNING: ThreadSanitizer: data race", "x.cpp:1: runtime error: y"):
            self.assertEqual(self.judged(("a", "Failed", f"***Excusable A.B\n{line}\n"))[0], [])

    def test_what_ctest_cut_off_may_be_anything(self):
        self.assertEqual(self.judged(("a", "Failed", "***Excusable A.B\n" + judge.CUT))[0], [])

    def test_others_do_not_spoil_an_excuse(self):
        again, final = self.judged(("integration.A.B/0 # (1, 2)", "Failed", "***Excusable A.B/0\n"),
                                   ("unit.C.D", "Failed", "wrong\n"))
        self.assertEqual(again, ["0:integration.A.B/0 # (1, 2)"])
        self.assertEqual(len(final), 1)

    def test_more_than_ten_are_no_excuse(self):
        def cases(count):
            return [(f"t{number}", "Failed", "***Excusable A.B\n") for number in range(count)]
        self.assertEqual(len(self.judged(*cases(10))[0]), 10)
        again, final = self.judged(*cases(11))
        self.assertEqual((again, len(final)), ([], 11))
        self.assertEqual(len(self.judged(*cases(11), stolen=10)[0]), 11)

    def test_no_failure_at_all(self):
        self.assertEqual(self.judged(), ([], []))


class AwaitProcessors(unittest.TestCase):
    def looks(self, shares, patience_s):
        """How often it looked at shares that others take, until it went on."""
        left = list(shares)
        with unittest.mock.patch.multiple(await_processors, stolen_share=lambda: left.pop(0),
                                          PAUSE_S=0.01), \
                unittest.mock.patch.object(sys, "argv", ["", str(patience_s)]), \
                contextlib.redirect_stdout(io.StringIO()), \
                contextlib.redirect_stderr(io.StringIO()):
            await_processors.main()
        return len(shares) - len(left)

    def test_it_waits_while_others_take_them_and_no_longer_than_it_may(self):
        self.assertEqual(self.looks([0.0, 0.9], 60), 1)
        self.assertEqual(self.looks([0.5, 0.4, 0.05, 0.9], 60), 3)
        self.assertLess(self.looks([0.9] * 1000, 0.2), 1000)
        self.assertEqual(self.looks([0.9], 0), 0)


class Tries(unittest.TestCase):
    """run_tests of run.sh, with a stand-in for ctest."""

    STAND_IN = """
        set -euo pipefail
        cd "$1"
        results=$2 left=($3)
        tests=0 skipped=0 stolen_percent=0 failed=() excused=()
        failed_list() { echo "$results/list"; }
        run_once() {  # of a test that fails, with its excuse, or passes
          stolen_percent=${left[0]%:*}
          local said=""
          : >"$results/list"
          if [ "${left[0]#*:}" != passes ]; then
            echo 1:it >"$results/list"
            said="<system-out>***Excusable ${left[0]#*:}</system-out>"
            [ "${left[0]#*:}" = fails ] || said=""
          fi
          printf '<testsuite><testcase name="it">%s</testcase></testsuite>' "$said" \\
            >"$results/$2.xml"
          echo "The following tests FAILED:" >"$results/$2.log"
          [ ! -s "$results/list" ] || echo "  1 - it (Failed)" >>"$results/$2.log"
          left=("${left[@]:1}")
        }
        run_tests default kind 3 2>"$results/said"
        echo "${#left[@]} left, failed: ${failed[*]:-} excused: ${excused[*]:-}"
        """

    def tried(self, runs):
        """What comes of runs, each "PERCENT_STOLEN:fails|crashes|passes"."""
        script = (SUPPORT.parent / "run.sh").read_text()
        function = script[script.index("run_tests() {"):script.index("# Deletes programs")]
        numbers = next(line for line in script.splitlines() if line.startswith("stolen_most_"))
        with tempfile.TemporaryDirectory() as folder:
            run = subprocess.run(
                ["bash", "-c", f"{numbers}\n{function}\n{textwrap.dedent(self.STAND_IN)}", "-",
                 str(SUPPORT.parents[1]), folder, runs],
                text=True, capture_output=True, check=False)
        self.assertEqual(run.returncode, 0, run.stderr)
        return run.stdout.strip()

    def test_so_many_as_are_allowed(self):
        self.assertEqual(self.tried("0:passes 0:fails"), "1 left, failed:  excused:")
        self.assertEqual(self.tried("0:fails 0:passes 0:fails"), "1 left, failed:  excused: it")
        self.assertEqual(self.tried("4:fails 0:fails 4:fails 0:passes"),
                         "1 left, failed: it excused:")

    def test_five_do_not_count_where_the_host_took_the_processors(self):
        self.assertEqual(self.tried("20:fails 5:fails 0:fails 0:fails 0:passes 0:fails"),
                         "1 left, failed:  excused: it")
        self.assertEqual(self.tried("20:fails 5:fails 0:fails 0:fails 0:fails 0:passes"),
                         "1 left, failed: it excused:")
        self.assertEqual(self.tried("20:fails " * 8 + "0:passes"), "1 left, failed: it excused:")

    def test_without_an_excuse_one_is_enough(self):
        self.assertEqual(self.tried("20:crashes 0:passes"), "1 left, failed: it excused:")


class RunTests(unittest.TestCase):
    def ran(self, body):
        """(exit code, output) of a file of tests with this in its class."""
        with tempfile.TemporaryDirectory() as folder:
            pathlib.Path(folder, "it_test.py").write_text(
                "import subprocess, unittest\nfrom excuse import busy_machine_may_explain\n"
                "import crash\nclass It(unittest.TestCase):\n" + textwrap.indent(body, "    "))
            run = subprocess.run([sys.executable, "-m", "run_tests", "it_test"], cwd=folder,
                                 env={**os.environ, "PYTHONPATH": str(SUPPORT)}, text=True,
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
            return run.returncode, run.stdout

    EXCUSABLE = ("def test_excusable(self):\n"
                 "    with busy_machine_may_explain(): self.assertLess(2, 1)\n")

    def test_only_marked_failures_are_excusable(self):
        code, said = self.ran(self.EXCUSABLE + "def test_other(self): pass\n"
                              "def test_skipped(self): self.skipTest('so')\n")
        self.assertEqual(code, 1)
        self.assertIn("\n***Excusable it_test.It.test_excusable\n", said)
        self.assertIn("2 not less than 1", said)

    def test_subtests_are_judged_each(self):
        subtests = ("def test_parts(self):\n"
                    "    with self.subTest(1), busy_machine_may_explain(): self.fail('a')\n"
                    "    with self.subTest(2): {}\n")
        self.assertIn("***Excusable", self.ran(subtests.format("pass"))[1])
        code, said = self.ran(subtests.format("self.fail('b')"))
        self.assertEqual(code, 1)
        self.assertNotIn("***Excusable", said)

    def test_one_failure_for_good_leaves_none_excusable(self):
        for other in ("def test_a(self): self.fail('x')", "def test_a(self): raise OSError('x')",
                      "def tearDown(self): self.fail('x')", "def setUp(self): self.fail('x')",
                      "@classmethod\ndef tearDownClass(cls): raise AssertionError('x')",
                      "@unittest.expectedFailure\ndef test_a(self): pass",
                      "def test_a(self):\n"
                      "    with busy_machine_may_explain(): raise OSError('x')",
                      "def test_a(self): subprocess.run('kill -SEGV $$', shell=True)"):
            code, said = self.ran(self.EXCUSABLE + other + "\n")
            self.assertEqual(code, 1, said)
            self.assertNotIn("***Excusable", said, other)

    def test_a_crash_fails_tests_that_pass(self):
        code, said = self.ran("def test_a(self): subprocess.run('kill -SEGV $$', shell=True)\n")
        self.assertEqual(code, 1)
        self.assertIn("FAILED: ***Exception: signal 11", said)

    def test_a_daemon_that_ends_badly_is_never_excusable(self):
        for end in ("exec sh -c 'exit 3'", "kill -SEGV $$"):
            code, said = self.ran(
                "def test_a(self):\n"
                f"    process = subprocess.Popen([\"sh\", \"-c\", \"{end}\"])\n"
                "    with busy_machine_may_explain(): crash.end_in_order(process, 20.0, [])\n")
            self.assertEqual(code, 1)
            self.assertIn("crash.BadEnd", said)
            self.assertNotIn("***Excusable", said)

    def test_what_passes_needs_no_excuse(self):
        code, said = self.ran("def test_a(self):\n"
                              "    with busy_machine_may_explain(): self.assertLess(1, 2)\n")
        self.assertEqual((code, "***" in said), (0, False), said)



class CountCases(unittest.TestCase):
    def counted(self, output, status="run"):
        case = xml.etree.ElementTree.Element("testcase", status=status)
        xml.etree.ElementTree.SubElement(case, "system-out").text = output
        return count_cases.cases(case)

    def test_a_program_of_googletest(self):
        said = "[==========] Running 12 tests from 3 test suites.\nx\n[  PASSED  ] 10 tests.\n"
        self.assertEqual(self.counted(said), (12, 0))
        self.assertEqual(self.counted(said + "[  SKIPPED ] 2 tests, listed below:\n"), (12, 2))
        self.assertEqual(self.counted("[==========] Running 1 test from 1 test suite.\n"), (1, 0))

    def test_a_file_of_python(self):
        self.assertEqual(self.counted("Ran 7 tests in 1.2s\n\nOK\n"), (7, 0))
        self.assertEqual(self.counted("Ran 7 tests in 1.2s\n\nOK (skipped=2)\n"), (7, 2))
        self.assertEqual(self.counted("Ran 7 tests in 1s\n\nFAILED (failures=1, skipped=2)\n",
                                      "fail"), (7, 2))

    def test_anything_else_is_one(self):
        self.assertEqual(self.counted("hello"), (1, 0))
        self.assertEqual(self.counted("", "notrun"), (1, 1))


if __name__ == "__main__":
    unittest.main()
