"""systemd's part for an installed palpated, where no systemd runs: the unit's user, environment and
command, and the end. Meanwhile the installed clients use it: COMMAND... is run in between. Run as
root in the root to test. Readiness, watchdog and reload: see daemon_service_test."""

import os
import pathlib
import pwd
import re
import shlex
import subprocess
import sys

from checks import check, check_run, check_settings, comes_true, edit_config, run

UNIT = "/lib/systemd/system/palpated.service"


def read_unit():
    """The last value of each key, and all variables of Environment= together."""
    values, environment = {}, {}
    for line in pathlib.Path(UNIT).read_text().splitlines():
        key, found, value = line.partition("=")
        if found and not line.startswith("#"):
            values[key] = value
            if key == "Environment":
                environment.update(word.split("=", 1) for word in shlex.split(value))
    return values, environment


def make_folders(unit):
    for base, key in (("/run", "RuntimeDirectory"), ("/var/lib", "StateDirectory"),
                      ("/var/cache", "CacheDirectory")):
        for name in unit[key].split():
            folder = pathlib.Path(base, name)
            folder.mkdir(parents=True, exist_ok=True)
            folder.chmod(int(unit[key + "Mode"], 8))
            check_run("chown", f"{unit['User']}:{unit['Group']}", str(folder))


def start(unit, environment):
    environment = dict(environment, PATH=os.environ["PATH"],
                       STATE_DIRECTORY="/var/lib/" + unit["StateDirectory"].split()[0])
    return subprocess.Popen(
        ["setsid", "setpriv", "--reuid", unit["User"], "--regid", unit["Group"], "--init-groups",
         "--no-new-privs", *shlex.split(unit["ExecStart"])],
        env=environment, cwd=unit["WorkingDirectory"], umask=int(unit["UMask"], 8))


def main():
    unit, environment = read_unit()
    make_folders(unit)
    # An upgrade keeps it.
    edit_config("stiffness_n_per_mm = 0.5", "stiffness_n_per_mm = 0.7")
    daemon = start(unit, environment)
    check("it serves", comes_true(lambda: run("palpate", "info")[0] == 0, 60))
    check_settings("stiffness_n_per_mm", "0.7")
    user = pwd.getpwnam(unit["User"]).pw_uid
    status = pathlib.Path(f"/proc/{daemon.pid}/status").read_text()
    check("it is not root", re.search(rf"^Uid:(\t{user}){{4}}$", status, re.M) is not None)
    # What the kernel gives to root, others of that account may not look into.
    check("its memory is its own", pathlib.Path(f"/proc/{daemon.pid}/mem").owner() == "root")
    if len(sys.argv) > 1:
        check(" ".join(sys.argv[1:]), subprocess.run(sys.argv[1:], check=False).returncode == 0)
    daemon.terminate()
    check("a clean end", daemon.wait(30) == 0)


if __name__ == "__main__":
    main()
