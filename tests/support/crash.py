"""Programs under test that crash or never end, said so that nobody takes them for a slow
machine: beside such a line tests/run.sh runs no test again.

Whoever imports this has every subprocess of its own watched, also those of subprocess.run.
"""

import signal
import subprocess


def found_by_a_sanitizer(text):
    return "Sanitizer" in text or "runtime error:" in text


class Watched(subprocess.Popen):
    """Says that it crashed: that a signal which no test sent ended it."""

    def __init__(self, *arguments, **named):
        self._sent = set()
        self.crashed = False
        super().__init__(*arguments, **named)

    def expect(self, number):
        """A test sends this signal by other ways."""
        self._sent.add(number)

    def send_signal(self, number):
        self.expect(number)
        super().send_signal(number)

    def poll(self):
        return self._judge(super().poll())

    def wait(self, timeout=None):
        return self._judge(super().wait(timeout))

    def communicate(self, *arguments, **named):
        try:
            said, errors = super().communicate(*arguments, **named)
        except subprocess.TimeoutExpired:
            if self._sent & {signal.SIGTERM, signal.SIGINT}:
                self.say_that_it_does_not_end()
            raise
        text = errors.decode(errors="replace") if isinstance(errors, bytes) else errors or ""
        if self.crashed or found_by_a_sanitizer(text):
            show([text])
        return said, errors

    def say_that_it_does_not_end(self):
        print(f"***Timeout: it was told to end, and does not: {self.args}", flush=True)

    def _judge(self, status):
        if status is not None and status < 0 and -status not in self._sent and not self.crashed:
            self.crashed = True
            print(f"***Exception: signal {-status} ended {self.args}", flush=True)
        return status


subprocess.Popen = Watched


def show(log):
    print("***Exception: last words\n" + "".join(log), flush=True)


def require_an_end(process, seconds):
    """The exit status of a program that was told to end. One that does not is killed, and fails
    the test."""
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.say_that_it_does_not_end()
        process.kill()
        process.wait(seconds)
        raise AssertionError(f"it did not end within {seconds:.0f} s") from None


def require_no_crash(process, log):
    """Fails the test where it crashed or a sanitizer speaks in these lines of its log."""
    if process.crashed or any(map(found_by_a_sanitizer, log)):
        show(log)
        raise AssertionError(f"it crashed: {process.args}")
