"""How soon the emergency stop acts on palpated's machine, beside floods of all kinds: by turns with
a control, a program of one thread that answers on a socket after two milliseconds. Judges times."""

import os
import pathlib
import socket
import statistics
import subprocess
import sys
import time
import unittest

from palpate._stop_socket import stop_by_socket, stop_socket_path
from palpate.v1 import (device_pb2, device_pb2_grpc, facts_pb2, pose_pb2, volume_pb2,
                        volume_stream_pb2)
from python_unread_test import plain_methods
from secured import ROLES, SecuredDaemon
from stolen import stolen_share
from support import PATIENCE_S

STOPS = int(os.environ.get("PALPATE_STOPS", "200"))
BETWEEN_S = 0.02
FLOOD_S = 60.0  # more than the stops take
MEDIAN_S, WORST_S = 0.02, 0.1
MORE_MISSED = 0.005
MANY_CALLS = "[limits]\ncalls_per_s = 100000\n"
# As urgent as the stop's thread.
CONTROL = """
import os, socket, sys, time
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(78))
except PermissionError:
    pass
listening = socket.socket(socket.AF_UNIX)
listening.bind(sys.argv[1])
listening.listen(100)
print("ready", flush=True)
while True:
    connection, _ = listening.accept()
    connection.recv(16)
    time.sleep(0.002)
    connection.send(b"done")
    connection.close()
"""


def started(path, message, goes_on=False):
    return f"{path}={message.SerializeToString().hex()}{'+' if goes_on else ''}"


def streams():
    poses = pose_pb2.StreamPosesRequest()
    poses.start.rate_hz = 60
    volume = volume_stream_pb2.StreamVolumeRequest()
    volume.start.SetInParent()
    follow = facts_pb2.FollowRequest()
    follow.start.SetInParent()
    return [started("/palpate.v1.PoseService/StreamPoses", poses, True),
            started("/palpate.v1.VolumeService/StreamVolume", volume, True),
            started("/palpate.v1.FactsService/Follow", follow, True)]


def upload():
    request = volume_pb2.UploadVolumeRequest()
    request.start.name = "a.nrrd"
    request.start.size_bytes = 1 << 20
    return started("/palpate.v1.VolumeService/UploadVolume", request, True)


GET_VOLUME = ["--method", "/palpate.v1.VolumeService/GetVolume"]
# Name: role and options of flood.py. Who stops and enables by turns is a kind of its own.
PLAIN = [method for method in plain_methods()
         if "StopForces" not in method and "EnableForces" not in method]
ENABLING = "forces that are enabled"
FLOODS = {"none": None,
          ENABLING: ("operator", ["--method", "/palpate.v1.DeviceService/EnableForces"])}
for number, role in enumerate(ROLES):
    reads = ["--reads"] * (number % 2)
    many = ["--connections", "900" if number == 0 else "250"]
    FLOODS[f"plain calls, {role}"] = (
        role, [*(part for method in PLAIN for part in ("--method", method)), *reads, *many])
    FLOODS[f"streams, {role}"] = (
        role, [*(part for stream in streams() for part in ("--method", stream)), *reads, *many])
FLOODS |= {
    "GetVolume": ("viewer", GET_VOLUME),
    "GetVolume, read": ("viewer", [*GET_VOLUME, "--reads"]),
    "connections that come again": ("viewer", [*GET_VOLUME, "--again"]),
    "handshakes": ("viewer", ["--handshakes"]),
    "dripping uploads": ("operator", ["--method", upload()]),
    "uploads that are reset": ("operator", ["--method", upload(), "--resets"]),
    "the stop's socket": ("viewer", ["--stop-socket", "SOCKET"]),
}


class StopTimes(unittest.TestCase):
    def setUp(self):
        self.enterContext(stolen_share())
        self.daemon = self.enterContext(SecuredDaemon(MANY_CALLS))
        self.path = stop_socket_path(self.daemon.socket)
        self.control = str(self.daemon.folder / "control.sock")
        self.start([sys.executable, "-c", CONTROL, self.control]).stdout.readline()

    def start(self, command):
        process = self.enterContext(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        self.addCleanup(process.kill)
        return process

    def flood(self, seconds, role, options):
        options = [self.path if option == "SOCKET" else option for option in options]
        process = self.start(
            [sys.executable, pathlib.Path(__file__).with_name("flood.py"), str(self.daemon.port),
             str(seconds), str(self.daemon.authority.ca), str(self.daemon.tokens[role]), "--per-s",
             "4000", "--connections", "250", *options])
        self.assertEqual(process.stdout.readline(), "ready\n")
        return process

    def ask_control(self):
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(self.control)
            connection.sendall(b"stop\n")
            self.assertEqual(connection.recv(16), b"done")

    def servo(self):
        with self.daemon.local_channel() as channel:
            return device_pb2_grpc.DeviceServiceStub(channel).GetDevice(
                device_pb2.GetDeviceRequest(), timeout=PATIENCE_S).servo

    def check(self, name, flood, more_s=0.0):
        """Stops and control by turns. Returns the share of ticks that the servo missed."""
        before = self.servo()
        process = self.flood(FLOOD_S, *flood) if flood else None
        stops, controls = [], []
        for _ in range(STOPS):
            for ask, taken in ((lambda: stop_by_socket(self.path), stops),
                               (self.ask_control, controls)):
                began = time.monotonic()
                answer = ask()
                taken.append(time.monotonic() - began)
                if taken is stops:
                    self.assertIsNotNone(answer, "the stop would go by gRPC")
                    if ENABLING not in name:
                        # "off": by a flood with DisableForces.
                        self.assertIn(str(answer.state), ("stopped", "off"))
                time.sleep(BETWEEN_S / 2)
        if process:
            self.assertIsNone(process.poll(), "it ended too soon")
            process.kill()
            process.wait()
        after = self.servo()
        missed = (after.missed_ticks - before.missed_ticks) / (after.ticks - before.ticks)
        median_s, worst_s = statistics.median(stops), max(stops)
        print(f"{name}: median {1e3 * median_s:.1f} ms, worst {1e3 * worst_s:.1f}; control "
              f"{1e3 * statistics.median(controls):.1f}, {1e3 * max(controls):.1f}; "
              f"{100 * missed:.3f} % of the ticks missed", flush=True)
        self.assertLess(median_s, MEDIAN_S, name)
        self.assertLess(worst_s, max(WORST_S, 2 * max(controls)), name)
        return missed

    def check_all(self, name):
        missed = {kind: self.check(f"{name}, {kind}", flood) for kind, flood in FLOODS.items()}
        for kind, share in missed.items():
            self.assertLess(share, 2 * missed["none"] + MORE_MISSED, kind)

    def test_on_a_quiet_machine(self):
        self.check_all("quiet")

    def test_beside_two_busy_loops(self):
        for _ in range(2):
            self.start([sys.executable, "-c", "while True: pass"])
        self.check_all("busy")


if __name__ == "__main__":
    unittest.main()
