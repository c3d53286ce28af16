"""palpated as a service of a systemd that runs: what only that shows. Run as root where
the packages are installed and palpated has been started by systemd."""

import contextlib
import ctypes
import grp
import json
import os
import pathlib
import pwd
import shutil
import signal
import time
import urllib.error
import urllib.request

from checks import check, check_run, check_settings, comes_true, edit_config, run

PTRACE_SEIZE, PTRACE_INTERRUPT = 0x4206, 0x4207
WAIT_ALL = 0x40000000  # __WALL: threads are waited for as well

OVERRIDE = pathlib.Path("/etc/systemd/system/palpated.service.d/override.conf")
# The unit's rights as capabilities: the same calls, past the same filter.
CAPABILITIES = """[Service]
CapabilityBoundingSet=CAP_SYS_NICE CAP_IPC_LOCK
AmbientCapabilities=CAP_SYS_NICE CAP_IPC_LOCK
"""
# An address of this machine that is not localhost, as a viewer's elsewhere.
ADDRESS = "192.0.2.1"
WEB = "http://localhost:7480"
ALLOWED = f"""[Service]
IPAddressAllow={ADDRESS}
"""


def show(name, unit="palpated"):
    return run("systemctl", "show", "--value", "--property", name, unit)[1]


def is_serving():
    return show("ActiveState") == "active" and run("palpate", "info")[0] == 0


def main_pid(unit="palpated"):
    return int(show("MainPID", unit))


def status_of(pid):
    lines = pathlib.Path(f"/proc/{pid}/status").read_text().splitlines()
    return {key: value.split() for key, _, value in (line.partition(":") for line in lines)}


def check_rights(unit, user):
    status = status_of(main_pid(unit))
    check(f"{unit} is not root", status["Uid"] == [str(pwd.getpwnam(user).pw_uid)] * 4)
    check("no capabilities", int(status["CapBnd"][0], 16) == 0)
    check("no new privileges", status["NoNewPrivs"] == ["1"])
    check("filtered system calls", status["Seccomp"] == ["2"])


def check_sandbox():
    check_rights("palpated", "palpate")
    check("its memory is its own", pathlib.Path(f"/proc/{main_pid()}/mem").owner() == "root")
    check("the status: " + show("StatusText"), "forces" in show("StatusText"))


@contextlib.contextmanager
def override(text):
    """What `systemctl edit palpated` writes."""
    OVERRIDE.parent.mkdir()
    OVERRIDE.write_text(text)
    restart()
    yield
    shutil.rmtree(OVERRIDE.parent)
    restart()


def restart():
    check_run("systemctl", "daemon-reload")
    check_run("systemctl", "reset-failed", "palpated")  # the count of starts
    check_run("systemctl", "restart", "palpated")


def has_realtime():
    return "FIFO scheduling: yes; memory locked: yes" in check_run("palpate", "info")


def may_raise_limits():
    """What this machine's systemd may: CAP_SYS_RESOURCE."""
    return int(status_of(1)["CapEff"][0], 16) >> 24 & 1 == 1


def check_realtime():
    if may_raise_limits():
        check("SCHED_FIFO and locked memory", has_realtime())
        return
    print("skip  the unit's LimitRTPRIO and LimitMEMLOCK: nobody may raise limits here")
    with override(CAPABILITIES):
        check("SCHED_FIFO and locked memory by capabilities", has_realtime())


def check_features():
    """The importer, files and recordings, within the sandbox."""
    folder = "/var/lib/palpate/volumes"
    check_run("palpate", "save", f"{folder}/copy.nrrd")
    check_run("palpate", "load", f"{folder}/copy.nrrd")
    check_run("palpate", "download", "/root/copy.nrrd")
    check_run("palpate", "upload", "/root/copy.nrrd")
    check_run("palpate", "record", "start", f"{folder}/trial.mcap")
    time.sleep(1)
    check_run("palpate", "record", "stop")
    check("not saved elsewhere", run("palpate", "save", "/opt/copy.nrrd")[0] != 0)
    for name in ("copy.nrrd", "trial.mcap"):
        pathlib.Path(folder, name).unlink()


def check_reload():
    pid = main_pid()
    edit_config("stiffness_n_per_mm = 0.7", "stiffness_n_per_mm = 0.8")
    check_run("systemctl", "reload", "palpated")
    # The reload is the signal; that it is done is told a moment later.
    check("reloaded", comes_true(lambda: "stiffness 0.8" in run("palpate", "info")[1]
                                 .replace("  ", " ")))
    check_settings("stiffness_n_per_mm", "0.8")
    edit_config("stiffness_n_per_mm = 0.8", "stiffness_n_per_mm = 80")
    check("a faulty configuration is refused", run("systemctl", "reload", "palpated")[0] != 0)
    check("and nothing ends", main_pid() == pid and is_serving())
    edit_config("stiffness_n_per_mm = 80", "stiffness_n_per_mm = 0.7")


class StuckServo:
    """Stops the servo's thread and no other, as a fault in it would: the daemon's main
    thread, which feeds the watchdog, runs on."""

    def __init__(self, pid):
        self.thread, = (int(task.name) for task in pathlib.Path(f"/proc/{pid}/task").iterdir()
                        if (task / "comm").read_text().strip() == "palpate-rt")
        ptrace = ctypes.CDLL(None, use_errno=True).ptrace
        ptrace.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]
        check("the servo may be stopped here", ptrace(PTRACE_SEIZE, self.thread, None, None) == 0)
        ptrace(PTRACE_INTERRUPT, self.thread, None, None)
        os.waitpid(self.thread, WAIT_ALL)

    def is_gone(self):
        """Its process was ended: a thread that is traced lingers until it is asked for."""
        thread, status = os.waitpid(self.thread, WAIT_ALL | os.WNOHANG)
        return thread == self.thread and not os.WIFSTOPPED(status)


def check_faults():
    pid, restarts = main_pid(), int(show("NRestarts"))
    servo = StuckServo(pid)
    check("the watchdog ends a daemon whose servo is stuck", comes_true(servo.is_gone))
    check("and it is started again", comes_true(is_serving) and main_pid() != pid)
    check("once", int(show("NRestarts")) == restarts + 1)
    _, log = run("journalctl", "--unit", "palpated", "--no-pager")
    check("as the log says", "Watchdog timeout" in log)
    pid = main_pid()
    os.kill(pid, signal.SIGKILL)
    check("started again after SIGKILL",
          comes_true(lambda: main_pid() not in (0, pid) and is_serving()))


def check_remote_viewer():
    """As deploy/guides/remote.md says it."""
    folder = pathlib.Path("/etc/palpate/tls")
    folder.mkdir()
    certificate, key, token = folder / "palpated.pem", folder / "palpated.key", "/root/token"
    check_run("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
              "-nodes", "-subj", "/CN=palpated", "-addext", f"subjectAltName=IP:{ADDRESS}",
              "-keyout", str(key), "-out", str(certificate))
    shutil.chown(key, "root", "palpate")
    key.chmod(0o640)
    text = check_run("palpated", "token", "add", "viewer", "--role", "viewer").splitlines()[-1]
    pathlib.Path(token).write_text(text)
    os.chmod(token, 0o600)
    edit_config('# listen = "127.0.0.1:7400"', 'listen = "0.0.0.0:7400"')
    for name in ("certificate", "key", "tokens"):
        edit_config(f"# {name} = ", f"{name} = ")
    check_run("ip", "address", "add", ADDRESS, "dev", "lo")
    info = ("palpate", "--server", f"{ADDRESS}:7400", "--tls-ca", str(certificate),
            "--token-file", token, "info")
    restart()
    check("a remote viewer is kept out by the unit", run(*info)[0] == 8)
    with override(ALLOWED):
        check_run(*info)


def asks(path, body=None):
    """The status of palpate-web's answer; 0: none."""
    request = urllib.request.Request(WEB + path, body and json.dumps(body).encode(), {
        "Content-Type": "application/json", "Origin": WEB})
    try:
        return urllib.request.urlopen(request, timeout=10).status
    except urllib.error.HTTPError as error:
        return error.code
    except OSError:
        return 0


def check_roles():
    """A socket for each role, as deploy/guides/service.md says it."""
    edit_config("# viewer_group = ", "viewer_group = ")
    restart()
    check("a group has the socket of viewers",
          pathlib.Path("/run/palpate/palpated-viewer.sock").group() == "palpate-viewers")
    check_run("useradd", "--groups", "palpate-viewers", "ada")
    ada = ("runuser", "-u", "ada", "--", "palpate")
    check("its members watch", "viewer socket (you)" in check_run(*ada, "who"))
    check("and change nothing", run(*ada, "set", "stiffness", "0.5")[0] == 5)
    check("but stop the forces", "stopped" in check_run(*ada, "device", "stop"))
    check_run("palpate", "device", "enable")


def check_web():
    """The gateway as deploy/guides/web.md says it."""
    state = [run("systemctl", question, "palpate-web")[1] for question in ("is-enabled", "is-active")]
    check(f"palpate-web waits for an administrator: {state}", state == ["disabled", "inactive"])
    edit_config('# listen = "127.0.0.1:7400"', 'listen = "127.0.0.1:7400"')
    restart()
    key = pathlib.Path("/etc/palpate/web-room-key")
    key.write_text(check_run("openssl", "rand", "-hex", "16") + "\n")
    shutil.chown(key, "root", "palpate-web")
    key.chmod(0o640)
    edit_config("# key_file = ", "key_file = ", "palpate-web")
    check_run("systemctl", "start", "palpate-web")
    check_rights("palpate-web", "palpate-web")
    check("it may not open palpated's usual socket", str(grp.getgrnam("palpate").gr_gid)
          not in status_of(main_pid("palpate-web"))["Groups"])
    check("it reaches palpated", comes_true(lambda: asks("/health") == 200))
    check("the page is there", asks("/app.js") == 200)
    check("a guest without the key is kept out", asks("/login", {"room": "0" * 32}) == 403)
    check("a guest with the key is let in", asks("/login", {"room": key.read_text().strip()}) == 200)
    pid = main_pid("palpate-web")
    os.kill(pid, signal.SIGKILL)
    check("palpate-web is started again after SIGKILL",
          comes_true(lambda: main_pid("palpate-web") not in (0, pid) and asks("/health") == 200))
    check_run("systemctl", "restart", "palpated")
    check("it comes back with palpated", comes_true(lambda: asks("/health") == 200))
    edit_config('server = "127', '# server = "127', "palpate-web")
    edit_config('# socket = "/run', 'socket = "/run', "palpate-web")
    check_run("systemctl", "restart", "palpate-web")
    check("it reaches palpated's socket of viewers", comes_true(lambda: asks("/health") == 200))
    check("and is one", "viewer socket" in check_run("palpate", "who"))


def check_log():
    _, warnings = run("journalctl", "--unit", "palpated", "--priority", "4", "--no-pager")
    _, all_lines = run("journalctl", "--unit", "palpated", "--no-pager")
    check("the journal knows levels", "ready on" in all_lines and "ready on" not in warnings)
    check("lines come without a time of their own", "info ready on" not in all_lines)


def check_end():
    check_run("systemctl", "stop", "palpated")
    check("a clean end", show("Result") == "success" and show("ExecMainStatus") == "0")
    check("no socket is left", not pathlib.Path("/run/palpate").exists())
    check_run("systemctl", "start", "palpated")
    check("started", is_serving())


def main():
    check("started at boot", comes_true(is_serving))
    check_sandbox()
    check_realtime()
    check_features()
    check_reload()
    check_faults()
    check_log()
    check_roles()
    check_web()
    # For what follows, palpated listens elsewhere; palpate-web waits.
    edit_config('listen = "127.0.0.1:7400"', '# listen = "127.0.0.1:7400"')
    check_remote_viewer()
    check_end()


if __name__ == "__main__":
    main()
