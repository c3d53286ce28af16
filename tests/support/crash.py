"""Programs under test that crash or never end, said so that nobody takes them for a slow
machine: beside such a line tests/run.sh runs no test again.

Whoever imports this has every subprocess of its own watched, also those of subprocess.run.
"""

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
        said, errors = super().communicate(*arguments, **named)
        text = errors.decode(errors="replace") if isinstance(errors, bytes) else errors or ""
        show_crash(self, [text])
        return said, errors

    def _judge(self, status):
        if status is not None and status < 0 and -status not in self._sent and not self.crashed:
            self.crashed = True
            print(f"***Exception: signal {-status} ended {self.args}", flush=True)
        return status


subprocess.Popen = Watched


def wait_for_end(process, seconds):
    """The exit status of a program that was told to end. One that does not is killed."""
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        print(f"***Timeout: after {seconds:.0f} s there is still {process.args}", flush=True)
        process.kill()
        return process.wait(seconds)


def show_crash(process, log):
    """The lines of its log, where it crashed or a sanitizer speaks in them."""
    if process.crashed or any(map(found_by_a_sanitizer, log)):
        print("***Exception: last words\n" + "".join(log), flush=True)
