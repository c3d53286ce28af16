"""What clients get while palpated loads its first volume: an importer stands still until it is let
go, or fails."""

import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import grpc
import numpy as np

import palpate

from support import PALPATE, PALPATED, PATIENCE_S, nrrd, wait_until

IMPORT = pathlib.Path(PALPATED).parent / "palpate-import"
# 40 % of the whole: "progress" of the importer is a share of its own.
IMPORTER = """#!/bin/sh
echo "progress 0.4 reading"
while [ ! -e "{folder}/go" ]; do sleep 0.05; done
[ "$(cat {folder}/go)" = fail ] && {{ echo "palpate-import: head.nrrd: it is torn" >&2; exit 3; }}
exec {importer} "$@"
"""


class Loading(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(
            tempfile.TemporaryDirectory(prefix="palpate-loading-")))
        # The daemon runs the importer beside its own program.
        program = self.folder / "palpated"
        shutil.copy(PALPATED, program)
        importer = self.folder / "palpate-import"
        importer.write_text(IMPORTER.format(folder=self.folder, importer=IMPORT))
        importer.chmod(0o755)
        values = np.zeros((24, 24, 24), np.uint8)
        values[8:16, 8:16, 8:16] = 200
        (self.folder / "head.nrrd").write_bytes(nrrd(values))
        self.socket = str(self.folder / "s.sock")
        self.log = open(self.folder / "log", "w+", encoding="utf-8")
        self.addCleanup(self.log.close)
        self.daemon = subprocess.Popen(
            [program, self.folder / "head.nrrd", "--socket", self.socket, "--state-folder", ""],
            stdout=self.log, stderr=self.log)
        self.addCleanup(self.daemon.wait)
        self.addCleanup(self.daemon.kill)

    def go(self, how="on"):
        (self.folder / "go.new").write_text(how)
        (self.folder / "go.new").rename(self.folder / "go")

    def run_palpate(self, *arguments):
        return subprocess.run([PALPATE, *arguments, "--socket", self.socket], text=True,
                              capture_output=True, timeout=PATIENCE_S, check=False)

    def begin(self, *command):
        """Starts a client and returns once it says that it waits."""
        client = subprocess.Popen([*command, "--socket", self.socket], text=True,
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.addCleanup(client.kill)
        line = ""
        while "loading head.nrrd" not in line:
            line = client.stderr.readline()
            self.assertTrue(line, "the client ended")
        self.assertIsNone(client.poll())
        return client

    def end(self, client):
        said, complaint = client.communicate(timeout=PATIENCE_S)
        self.assertEqual(client.returncode, 0, complaint)
        return said

    def test_what_needs_no_volume_is_answered(self):
        stopped = self.run_palpate("device", "stop")
        self.assertEqual(stopped.returncode, 0, stopped.stderr)
        self.assertEqual(self.run_palpate("device", "enable").returncode, 0)
        changed = self.run_palpate("set", "stiffness", "0.7")
        self.assertEqual(changed.returncode, 0, changed.stderr)
        with palpate.connect(self.socket) as conn:
            self.assertEqual(conn.settings.stiffness_n_per_mm, 0.7)
            self.assertEqual(next(iter(conn.poses())).mode[0], palpate.ProxyMode.SUSPENDED)
        with grpc.insecure_channel(f"unix:{self.socket}") as channel:
            check = channel.unary_unary("/grpc.health.v1.Health/Check")
            self.assertEqual(check(b"", timeout=PATIENCE_S), b"\x08\x01")  # SERVING
        self.go()
        settings = self.run_palpate("settings")
        self.assertIn("stiffness 0.7", settings.stdout)

    def test_what_needs_one_waits(self):
        clients = [self.begin(PALPATE, "info"), self.begin(PALPATE, "watch", "--count", "5"),
                   self.begin(PALPATE, "set", "isovalue", "otsu")]
        script = ("import palpate, sys\n"
                  "print(palpate.connect(sys.argv[2]).volume.info().shape)")
        clients.append(self.begin(sys.executable, "-c", script))
        self.go()
        told = [self.end(client) for client in clients]
        self.assertIn("24 x 24 x 24", told[0])
        self.assertIn("24, 24, 24", told[3])

    def test_a_load_waits(self):
        client = self.begin(PALPATE, "load", "builtin:sphere:16")
        self.go()
        self.end(client)

    @unittest.skipUnless(os.environ.get("PALPATE_VIEW"), "no viewer was built")
    def test_the_viewer_waits(self):
        picture = self.folder / "a.png"
        viewer = self.begin(os.environ["PALPATE_VIEW"], "--offscreen", "--size", "64x64",
                            "--screenshot", str(picture))
        self.go()
        self.end(viewer)
        self.assertTrue(picture.exists())

    def test_a_volume_that_cannot_be_read_is_told(self):
        client = self.begin(PALPATE, "info")
        self.go("fail")
        _, complaint = client.communicate(timeout=PATIENCE_S)
        self.assertEqual(client.returncode, 3)
        self.assertIn("torn", complaint)
        self.assertEqual(self.daemon.wait(PATIENCE_S), 3)
        self.log.seek(0)
        self.assertIn("torn", self.log.read())

    def test_a_signal_ends_it(self):
        client = self.begin(PALPATE, "info")
        begun = time.monotonic()
        self.daemon.send_signal(signal.SIGTERM)
        self.assertEqual(self.daemon.wait(PATIENCE_S), 0)
        print(f"ended after {time.monotonic() - begun:.2f} s", file=sys.stderr)
        client.communicate(timeout=PATIENCE_S)
        self.assertEqual(client.returncode, 8)
        self.assertTrue(wait_until(lambda: not os.path.exists(self.socket)))


if __name__ == "__main__":
    unittest.main()
