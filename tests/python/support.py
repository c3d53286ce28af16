"""A real palpated in a folder of its own, and volumes for it."""

import os
import pathlib
import signal
import subprocess
import tempfile
import threading
import time
import unittest

import numpy as np

import palpate
from crash import end_in_order
from free_port import free_port

PALPATED = os.environ["PALPATED"]
PALPATE = os.environ["PALPATE"]
PATIENCE_S = 120.0


class Daemon:
    """Runs until end() or the end of a `with` block."""

    def __init__(self, volume="builtin:sphere:48", listen=None, more=()):
        self._folder = tempfile.TemporaryDirectory(prefix="palpate-python-")
        self.folder = pathlib.Path(self._folder.name)
        self.socket = str(self.folder / "palpated.sock")
        self._command = [PALPATED, "--volume", str(volume), "--socket", self.socket,
                         "--state-folder", str(self.folder / "state")]
        if listen:
            self._command += ["--listen", listen]
        if "--config" not in more:
            self._command += ["--load-folder", "/"]
        self._command += more
        self.start()

    def start(self):
        """Starts it, again after end(), and waits until it is ready."""
        self.process = subprocess.Popen(self._command, cwd=self.folder, stdout=subprocess.DEVNULL,
                                        stderr=subprocess.PIPE, text=True)
        said = self.said = []
        ready = threading.Event()

        def read():
            # To the end: a daemon whose log nobody reads stands still.
            for line in self.process.stderr:
                said.append(line)
                if "ready on" in line:
                    ready.set()
            ready.set()

        self._reader = threading.Thread(target=read, daemon=True)
        self._reader.start()
        if not ready.wait(PATIENCE_S) or not any("ready on" in line for line in said):
            self.end(signal.SIGKILL)
            raise RuntimeError("palpated did not start: " + "".join(said))

    def stand_still(self):
        """Until SIGCONT. The signal is there before the last thread has stopped."""
        self.process.send_signal(signal.SIGSTOP)
        tasks = pathlib.Path(f"/proc/{self.process.pid}/task")

        def stands():
            return all(stat.read_text().rpartition(")")[2].split()[0] == "T"
                       for stat in tasks.glob("*/stat"))
        if not wait_until(stands):
            raise RuntimeError("palpated does not stop")

    def end(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(number)

        def close():
            self._reader.join(PATIENCE_S)
            self.process.stderr.close()

        end_in_order(self.process, PATIENCE_S, self.said, close)

    def connect(self):
        return palpate.connect(self.socket)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()
        self._folder.cleanup()


class DaemonTest(unittest.TestCase):
    """One daemon and one connection for all tests of a class."""

    volume = "builtin:sphere:48"

    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(Daemon(cls.volume))
        cls.conn = cls.enterClassContext(cls.daemon.connect())


def wait_until(holds, seconds=20.0):
    """Whether it held within that time."""
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def pattern(shape, kind=np.float32):
    """(nx, ny, nz): a value that names its own place, so that no two axes can be confused."""
    i, j, k = np.indices(shape)
    return (10000 * i + 100 * j + k).astype(kind)


def nrrd(values, directions, origin):
    """Bytes of an NRRD file of float32, written without the package: x fastest."""
    vectors = " ".join(f"({d[0]!r},{d[1]!r},{d[2]!r})" for d in directions)
    header = ("NRRD0004\ntype: float\ndimension: 3\nspace: left-posterior-superior\n"
              f"sizes: {values.shape[0]} {values.shape[1]} {values.shape[2]}\n"
              f"space directions: {vectors}\n"
              f"space origin: ({origin[0]!r},{origin[1]!r},{origin[2]!r})\n"
              "endian: little\nencoding: raw\n\n")
    data = bytearray(header.encode())
    for k in range(values.shape[2]):
        for j in range(values.shape[1]):
            data += values[:, j, k].astype("<f4").tobytes()
    return bytes(data)
