"""A crash of palpated, said so that nobody takes it for a slow machine."""

import signal

CRASHES = {-signal.SIGSEGV, -signal.SIGABRT, -signal.SIGBUS, -signal.SIGFPE, -signal.SIGILL}


def show_crash(status, log):
    """Prints the log where this exit status, or a sanitizer in it, says that it crashed. A test
    that fails beside such a line is not run again."""
    if status in CRASHES or any("Sanitizer" in line or "runtime error:" in line for line in log):
        print(f"***Exception: palpated crashed ({status})\n" + "".join(log), flush=True)
