"""What both harnesses need: checks that end the run, and a servo that stands still."""

import ctypes
import os
import pathlib
import subprocess
import sys
import time

PTRACE_SEIZE, PTRACE_INTERRUPT, PTRACE_DETACH = 0x4206, 0x4207, 17
WAIT_ALL = 0x40000000  # __WALL: threads are waited for as well


def check(what, good):
    print(("ok    " if good else "FAIL  ") + what, flush=True)
    if not good:
        sys.exit(1)


def run(*command):
    """Exit code, and all that was written."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          check=False)
    return done.returncode, done.stdout.strip()


def check_run(*command):
    code, output = run(*command)
    check(" ".join(command) + ("" if code == 0 else f": {code} {output[-500:]}"), code == 0)
    return output


def comes_true(condition, patience_s=30):
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.1)
    return False


def edit_config(before, after):
    config = pathlib.Path("/etc/palpate/palpated.toml")
    text = config.read_text()
    check(f"the configuration has {before}", before in text)
    config.write_text(text.replace(before, after))


def check_settings(name, expected):
    """By a Python client."""
    script = f"import palpate; print(palpate.connect().settings.{name})"
    code, answer = run(sys.executable, "-c", script)
    check(f"{name} is {answer[-300:]}", code == 0 and answer == expected)


def servo_thread(pid):
    for task in pathlib.Path(f"/proc/{pid}/task").iterdir():
        if (task / "comm").read_text().strip() == "palpate-rt":
            return int(task.name)
    return 0


class StuckServo:
    """Stops the servo's thread and no other, as a fault in it would: the daemon's main
    thread, which feeds the watchdog, runs on."""

    def __init__(self, pid):
        self.thread = servo_thread(pid)
        check("there is a servo thread", self.thread > 0)
        self._ptrace = ctypes.CDLL(None, use_errno=True).ptrace
        self._ptrace.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]
        check("the servo may be stopped here",
              self._ptrace(PTRACE_SEIZE, self.thread, None, None) == 0)
        self._ptrace(PTRACE_INTERRUPT, self.thread, None, None)
        os.waitpid(self.thread, WAIT_ALL)

    def go_on(self):
        self._ptrace(PTRACE_DETACH, self.thread, None, None)

    def is_gone(self):
        """Its process was ended: a thread that is traced lingers until it is asked for."""
        thread, status = os.waitpid(self.thread, WAIT_ALL | os.WNOHANG)
        return thread == self.thread and not os.WIFSTOPPED(status)
