"""What one client changes, the others see within 100 ms, and strangers who attack do not delay the
emergency stop."""

import json
import statistics
import subprocess
import tempfile
import threading
import time
import unittest

import numpy as np

from palpate.v1 import device_pb2, device_pb2_grpc
from python_strangers_test import Stranger, endless_headers
from secured import SecuredDaemon
from stolen import stolen_share
from support import PALPATE, PATIENCE_S, DaemonTest

CHANGES = 150
BOUND_MS = 100.0


class Arrivals:
    """When each isovalue was first seen, s of the monotonic clock."""

    def __init__(self):
        self._first = {}
        self._changed = threading.Condition()

    def put(self, isovalue):
        with self._changed:
            if self._first.setdefault(isovalue, time.monotonic()):
                self._changed.notify_all()

    def wait(self, isovalue):
        with self._changed:
            if not self._changed.wait_for(lambda: isovalue in self._first, PATIENCE_S):
                raise TimeoutError(f"the isovalue {isovalue} was never seen")
            return self._first[isovalue]


class IsovalueInOtherClients(DaemonTest):
    def test_a_change_reaches_python_and_cpp(self):
        in_python, in_cpp = Arrivals(), Arrivals()
        stream = self.enterContext(self.enterContext(self.daemon.connect()).poses(rate_hz=250))
        watcher = self.enterContext(subprocess.Popen(
            [PALPATE, "watch", "--json", "--rate-hz", "250", "--socket", self.daemon.socket],
            stdout=subprocess.PIPE, text=True))

        def watch_in_python():
            for poses in stream:
                in_python.put(float(poses.isovalue[-1]))

        def watch_in_cpp():
            for line in watcher.stdout:
                in_cpp.put(json.loads(line)["isovalue"])

        threads = [threading.Thread(target=watch) for watch in (watch_in_python, watch_in_cpp)]
        for thread in threads:
            thread.start()
        try:
            for arrivals in (in_python, in_cpp):
                arrivals.wait(self.conn.settings.isovalue)
            with stolen_share():
                found_ms = [self.change(n, (in_python, in_cpp)) for n in range(CHANGES)]
        finally:
            watcher.terminate()
            stream.close()
            for thread in threads:
                thread.join()
        p99_ms = {}
        for name, latencies_ms in zip(("its own call", "Python", "C++"), zip(*found_ms)):
            p50, p99_ms[name] = np.percentile(latencies_ms, [50, 99])
            print(f"isovalue, {name}: p50 {p50:.1f} ms, p99 {p99_ms[name]:.1f} ms of {CHANGES}")
        # What the machine does to the call itself it may do to the daemon and to who watches.
        bound_ms = max(BOUND_MS, 3 * p99_ms.pop("its own call"))
        for name, p99 in p99_ms.items():
            self.assertLess(p99, bound_ms, name)

    def change(self, number, others):
        """Milliseconds until the call has returned, and until each of the others has seen it."""
        isovalue = 0.2 + 0.6 * number / CHANGES
        begun = time.monotonic()
        self.conn.settings.isovalue = isovalue
        found = [time.monotonic(), *(arrivals.wait(isovalue) for arrivals in others)]
        # Not in step with the samples.
        time.sleep(0.003 * (number % 7))
        return [(at - begun) * 1e3 for at in found]


class EmergencyStop(unittest.TestCase):
    def setUp(self):
        folder = self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-python-"))
        self.daemon = self.enterContext(SecuredDaemon(folder))

    def stop_often(self, count):
        """Over TLS and on the socket; what each took, s."""
        taken = []
        with self.daemon.channel(token=self.daemon.tokens["viewer"]) as channel, \
                self.daemon.local_channel() as local:
            for stub in map(device_pb2_grpc.DeviceServiceStub, (channel, local)):
                for _ in range(count):
                    began = time.monotonic()
                    stub.StopForces(device_pb2.StopForcesRequest(), timeout=PATIENCE_S,
                                    wait_for_ready=True)
                    taken.append(time.monotonic() - began)
                    time.sleep(0.05)
        return taken

    def test_it_works_while_strangers_attack(self):
        end = threading.Event()

        def attack_on(address):
            while not end.is_set():
                try:
                    stranger = Stranger(self.daemon, address, patience_s=10.0)
                except OSError:
                    time.sleep(0.01)  # cut off within its handshake
                    continue
                try:
                    endless_headers(stranger, 400 << 20)
                except OSError:
                    pass
                stranger.close()

        with stolen_share():
            alone = self.stop_often(20)
            attackers = [threading.Thread(target=attack_on, args=(f"127.0.1.{n}",))
                         for n in range(1, 11)]
            for attacker in attackers:
                attacker.start()
            try:
                attacked = self.stop_often(50)
            finally:
                end.set()
                for attacker in attackers:
                    attacker.join()
        lines = sum("it sent too much" in line for line in self.daemon.said)
        p98 = np.percentile(attacked, 98)
        attacked_s, alone_s = statistics.median(attacked), statistics.median(alone)
        print(f"emergency stops while ten strangers attack: median {attacked_s * 1e3:.1f} ms, "
              f"p98 {p98 * 1e3:.0f} ms; without, median {alone_s * 1e3:.1f} ms; {lines} lines")
        self.assertLess(attacked_s, 10 * alone_s)
        self.assertLess(p98, 2.0)
        self.assertGreater(lines, 9)


if __name__ == "__main__":
    unittest.main()
