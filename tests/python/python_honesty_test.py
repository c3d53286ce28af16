"""A daemon's bad end fails the test that started it, and nothing excuses that."""

import os
import pathlib
import subprocess
import sys
import unittest

STAND_IN = pathlib.Path(__file__).parents[1] / "support" / "stand_in.sh"
# As unittest names what failed in them.
TESTS = {"Honesty.test_left_to_itself": "FAIL: test_left_to_itself",
         "Honesty.test_ended": "FAIL: test_ended",
         "HonestyOfAClass": "ERROR: tearDownClass"}


def run(stand_in, *tests):
    """(exit code, output); stand_in: what the daemon does at its end."""
    done = subprocess.run([sys.executable, "-m", "run_tests",
                           *(f"honesty_child.{test}" for test in tests)], text=True,
                          env={**os.environ, "PALPATED": STAND_IN, "PALPATE_STAND_IN": stand_in},
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return done.returncode, done.stdout


class Honesty(unittest.TestCase):
    def test_a_daemon_that_ends_badly_fails_its_test(self):
        for stand_in, line in (("abort", "it crashed: "), ("hang", "it did not end within 1 s"),
                               ("leak", "it crashed: "), ("fail", "it ended with 3, not with 0")):
            with self.subTest(stand_in=stand_in):
                code, said = run(stand_in, *TESTS)
                self.assertEqual(code, 1, said)
                for failure in TESTS.values():
                    self.assertIn(failure, said)
                self.assertGreaterEqual(said.count("crash.BadEnd: " + line), len(TESTS), said)
                self.assertNotIn("***Excusable", said)

    def test_one_that_ends_in_order_or_is_killed_fails_nothing(self):
        for stand_in, tests in (("order", TESTS), ("hang", ["Honesty.test_killed"])):
            code, said = run(stand_in, *tests)
            self.assertEqual(code, 0, said)


if __name__ == "__main__":
    unittest.main()
