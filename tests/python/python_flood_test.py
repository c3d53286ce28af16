"""The emergency stop, the end, a reload and a revocation beside clients that call and never read,
on a quiet machine and beside busy loops. Judges times."""

import pathlib
import signal
import statistics
import subprocess
import sys
import time
import unittest

import grpc

from palpate.v1 import device_pb2, device_pb2_grpc, pose_pb2, pose_pb2_grpc
from secured import SecuredDaemon
from stolen import stolen_share
from support import PATIENCE_S, Daemon, wait_until

SECONDS = 20
BUSY_RUNS = 20
MEDIAN_S, WORST_S, END_S = 0.1, 0.5, 2.0
MOST_BYTES = 200 << 20
MOST_LINES = 30
MANY_CALLS = "[limits]\ncalls_per_s = 100000\n"


class FloodTest(unittest.TestCase):
    def setUp(self):
        self.enterContext(stolen_share())

    def start(self, over_tls):
        """A daemon, and the channels on which it is stopped."""
        if over_tls:
            self.daemon = self.enterContext(SecuredDaemon(MANY_CALLS))
            channels = {"TLS": self.daemon.channel(self.daemon.tokens["viewer"])}
        else:
            self.daemon = self.enterContext(
                Daemon(listen=True, config={"limits": ["calls_per_s = 100000"]}))
            channels = {"loopback": grpc.insecure_channel(f"127.0.0.1:{self.daemon.port}")}
        channels["socket"] = grpc.insecure_channel("unix:" + self.daemon.socket)
        self.stubs = {name: device_pb2_grpc.DeviceServiceStub(self.enterContext(channel))
                      for name, channel in channels.items()}
        self.over_tls = over_tls
        self.stop_each()

    def stop_each(self):
        """What a stop on each channel takes, s."""
        taken_s = []
        for stub in self.stubs.values():
            began = time.monotonic()
            stub.StopForces(device_pb2.StopForcesRequest(), timeout=PATIENCE_S,
                            wait_for_ready=True)
            taken_s.append(time.monotonic() - began)
        return taken_s

    def flood(self):
        more = ([str(self.daemon.authority.ca), str(self.daemon.tokens["viewer"])]
                if self.over_tls else [])
        program = pathlib.Path(__file__).with_name("flood.py")
        process = self.enterContext(subprocess.Popen(
            [sys.executable, program, str(self.daemon.port), str(SECONDS), *more],
            stdout=subprocess.PIPE, text=True))
        self.addCleanup(process.kill)
        self.assertEqual(process.stdout.readline(), "ready\n")
        return process

    def be_busy(self):
        for _ in range(2):
            loop = self.enterContext(
                subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            self.addCleanup(loop.kill)

    def check_stops(self, name):
        own = sum("emergency stop" not in line for line in self.daemon.said)
        before = most = self.daemon.resident_bytes()
        flood = self.flood()
        taken_s = []
        while flood.poll() is None:
            taken_s += self.stop_each()
            most = max(most, self.daemon.resident_bytes())
            time.sleep(0.02)
        lines = sum("emergency stop" not in line for line in self.daemon.said) - own
        median_s, worst_s = statistics.median(taken_s), max(taken_s)
        print(f"{name}: {len(taken_s)} stops, median {median_s * 1e3:.1f} ms, worst "
              f"{worst_s * 1e3:.0f} ms; {flood.stdout.read().strip()}; memory "
              f"+{(most - before) >> 20} MiB; {lines} lines", flush=True)
        self.assertLess(median_s, MEDIAN_S)
        self.assertLess(worst_s, WORST_S)
        self.assertLess(most - before, MOST_BYTES)
        self.assertLessEqual(lines, MOST_LINES)


class Stop(FloodTest):
    def test_on_a_quiet_machine(self):
        for over_tls in (True, False):
            self.start(over_tls)
            self.check_stops(f"quiet, {'TLS' if over_tls else 'loopback'}")

    def test_beside_two_busy_loops(self):
        self.be_busy()
        for run in range(BUSY_RUNS):
            self.start(over_tls=run % 2 == 0)
            self.check_stops(f"busy, run {run}, {'TLS' if self.over_tls else 'loopback'}")
            self.daemon.end()


class Ends(FloodTest):
    def revoke_s(self, role):
        """Until a stream of this role ends."""
        channel = self.enterContext(self.daemon.channel(self.daemon.tokens[role]))
        start = pose_pb2.StreamPosesRequest(start=pose_pb2.StreamPosesStart(rate_hz=20))
        stream = pose_pb2_grpc.PoseServiceStub(channel).StreamPoses(iter([start]))
        next(stream)
        began = time.monotonic()
        self.daemon.revoke_token(role)
        with self.assertRaises(grpc.RpcError):
            for _ in stream:
                self.assertLess(time.monotonic() - began, PATIENCE_S)
        return time.monotonic() - began

    def test_revocation_reload_and_the_end(self):
        self.start(over_tls=True)
        self.flood()
        time.sleep(SECONDS / 4)

        def takes_s(act, what):
            """From the act to the daemon's line, s."""
            lines = len(self.daemon.said)
            began = time.monotonic()
            act()
            self.assertTrue(wait_until(
                lambda: any(what in line for line in self.daemon.said[lines:])), what)
            return time.monotonic() - began

        reload_s = takes_s(lambda: self.daemon.process.send_signal(signal.SIGHUP),
                           "configuration read again")
        revoke_s = self.revoke_s("viewer")
        began = time.monotonic()
        self.daemon.end()
        end_s = time.monotonic() - began
        print(f"in a flood: reload {reload_s:.2f} s, revocation {revoke_s:.2f} s, "
              f"SIGTERM {end_s:.2f} s")
        self.assertLess(max(reload_s, revoke_s, end_s), END_S)


if __name__ == "__main__":
    unittest.main()
