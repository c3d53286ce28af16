"""tests/support/crash.py: what programs under test make a test say, and how they fail it."""

import contextlib
import io
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
from crash import end_in_order, require_an_end, require_no_crash  # noqa: E402


def said_of(do):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        do()
    return said.getvalue()


def start(script, **named):
    return subprocess.Popen(["/bin/sh", "-c", script], **named)


class Crash(unittest.TestCase):
    def test_a_signal_that_nobody_sent_is_one(self):
        for number in (signal.SIGSEGV, signal.SIGKILL):
            said = said_of(start(f"kill -{int(number)} $$").wait)
            self.assertTrue(said.startswith(f"***Exception: signal {int(number)} "), said)

    def test_run_shows_the_last_words(self):
        said = said_of(lambda: subprocess.run("echo last words >&2; kill -ABRT $$", shell=True,
                                              capture_output=True, check=False))
        self.assertIn("***Exception", said)
        self.assertIn("last words\n", said)

    def test_a_sanitizer_is_heard(self):
        said = said_of(lambda: subprocess.run("echo x.cpp:1: runtime error: y >&2", shell=True,
                                              capture_output=True, check=False))
        self.assertIn("***Exception", said)
        process = start("exit 1")
        process.wait()
        with self.assertRaises(AssertionError):
            require_no_crash(process, ["ERROR: AddressSanitizer: y\n"])

    def test_a_crash_fails_a_test_that_would_pass(self):
        process = start("kill -SEGV $$")
        process.wait()
        with self.assertRaises(AssertionError):
            require_no_crash(process, [])

    def test_who_does_not_end_is_killed(self):
        def end(process):
            with self.assertRaises(AssertionError):
                require_an_end(process, 0.3)

        def communicate(process):
            with self.assertRaises(subprocess.TimeoutExpired):
                process.communicate(timeout=0.3)
            process.kill()
            process.wait()

        for do in (end, communicate):
            process = start("trap '' TERM; echo; while :; do sleep 0.1; done",
                            stdout=subprocess.PIPE)
            self.enterContext(process.stdout)
            process.stdout.readline()  # it is deaf
            process.send_signal(signal.SIGTERM)
            said = said_of(lambda: do(process))
            self.assertTrue(said.startswith("***Timeout"), said)
            self.assertEqual(process.returncode, -signal.SIGKILL)

    def test_a_daemon_ends_in_order_or_is_killed_by_its_test(self):
        self.assertEqual(end_in_order(start("exit 0"), 60.0, []), 0)
        with self.assertRaisesRegex(AssertionError, "it ended with 3(.|\\n)*said"):
            end_in_order(start("exit 3"), 60.0, ["said"])
        for number in (signal.SIGKILL, signal.SIGABRT):
            killed = start("exec sleep 60")
            killed.send_signal(number)
            self.assertEqual(end_in_order(killed, 60.0, []), -number)
        deaf = start("exec sleep 60")  # it does not know the signal
        deaf.terminate()
        with self.assertRaises(AssertionError):
            end_in_order(deaf, 60.0, [])

    def test_a_crash_fails_a_run_whose_tests_pass(self):
        support = str(pathlib.Path(__file__).parents[1] / "support")
        for command, status in (("kill -SEGV $$", 1), ("exit 3", 0)):
            with tempfile.TemporaryDirectory() as folder:
                pathlib.Path(folder, "it_test.py").write_text(
                    "import subprocess, unittest\nclass It(unittest.TestCase):\n"
                    f"    def test_it(self): subprocess.run({command!r}, shell=True)\n")
                run = subprocess.run([sys.executable, "-m", "run_tests", "it_test"], cwd=folder,
                                     env={**os.environ, "PYTHONPATH": support}, text=True,
                                     capture_output=True, check=False)
            self.assertEqual(run.returncode, status, run.stdout + run.stderr)

    def test_any_other_end_is_none(self):
        def sent(number):
            process = start("exec sleep 60")
            process.send_signal(number)
            self.assertEqual(require_an_end(process, 60.0), -number)
            require_no_crash(process, ["fine\n"])

        for number in (signal.SIGTERM, signal.SIGKILL, signal.SIGABRT):
            self.assertEqual(said_of(lambda: sent(number)), "")
        for code in (0, 3):
            self.assertEqual(said_of(start(f"exit {code}").wait), "")


if __name__ == "__main__":
    unittest.main()
