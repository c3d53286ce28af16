"""A test that passes but for the end of its daemon; python_honesty_test.py runs it. PALPATED is
tests/support/stand_in.sh here."""

import signal
import unittest

import support

support.PATIENCE_S = 1.0


class Honesty(unittest.TestCase):
    def test_left_to_itself(self):
        with support.Daemon():
            pass

    def test_ended(self):
        with support.Daemon() as daemon:
            daemon.end()

    def test_killed(self):
        with support.Daemon() as daemon:
            daemon.end(signal.SIGKILL)


class HonestyOfAClass(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.enterClassContext(support.Daemon())

    def test_nothing(self):
        pass
