"""What both harnesses need: checks that end the run."""

import pathlib
import subprocess
import sys
import time


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


def edit_config(before, after, program="palpated"):
    config = pathlib.Path(f"/etc/palpate/{program}.toml")
    text = config.read_text()
    check(f"the configuration has {before}", before in text)
    config.write_text(text.replace(before, after))


def check_settings(name, expected):
    """By a Python client."""
    script = f"import palpate; print(palpate.connect().settings.{name})"
    code, answer = run(sys.executable, "-c", script)
    check(f"{name} is {answer[-300:]}", code == 0 and answer == expected)
