"""Programs under test that crash or do not end: they fail the run.

Importing this watches every subprocess, also those of subprocess.run. What they do wrong is printed
and kept in `found`; run_tests.py fails where there is any.
"""

import signal
import subprocess


found = []


class BadEnd(AssertionError):
    """Of a program."""


def report(fault):
    found.append(fault)
    print(fault, flush=True)


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
        report(f"***Timeout: it was told to end, and does not: {self.args}")

    def was_killed(self):
        """By its test, in a way that is no order to end."""
        return bool(self._sent & {signal.SIGKILL, signal.SIGABRT})

    def _judge(self, status):
        if status is not None and status < 0 and -status not in self._sent and not self.crashed:
            self.crashed = True
            report(f"***Exception: signal {-status} ended {self.args}")
        return status


subprocess.Popen = Watched


def show(log):
    report("***Exception: last words\n" + "".join(log))


def require_an_end(process, seconds):
    """The exit status of a program that was told to end. One that does not is killed, and fails
    the test."""
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.say_that_it_does_not_end()
        process.kill()
        process.wait(seconds)
        raise BadEnd(f"it did not end within {seconds:.0f} s") from None


def require_no_crash(process, log):
    """Fails the test where it crashed or a sanitizer speaks in these lines of its log."""
    if process.crashed or any(map(found_by_a_sanitizer, log)):
        show(log)
        raise BadEnd(f"it crashed: {process.args}")


def end_in_order(process, seconds, log, close=lambda: None):
    """Of a daemon that was told to end: waits for it and returns its exit status. The test fails
    if it does not end, crashes, or ends with another status than 0, unless the test killed it.
    `close`: called once it is gone, before its log is read."""
    status = require_an_end(process, seconds)
    close()
    require_no_crash(process, log)
    if status != 0 and not process.was_killed():
        raise BadEnd(f"it ended with {status}, not with 0: {process.args}\n" + "".join(log))
    return status
