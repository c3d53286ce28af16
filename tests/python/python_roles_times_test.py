"""What floods on the viewer's socket take from the operator: its calls and stops on its own socket,
each at its time whatever the others do, and the same at a second palpated without a flood, the
control. Judges times."""

import pathlib
import statistics
import subprocess
import sys
import threading
import time
import unittest

import grpc

from palpate._address import role_socket_path
from palpate._stop_socket import stop_by_socket, stop_socket_path
from palpate.v1 import device_pb2, device_pb2_grpc, render_pb2, render_pb2_grpc
from python_stop_times_test import PLAIN, streams
from stolen import stolen_share
from support import PATIENCE_S, Daemon

SECONDS = 30
FLOOD_S, PER_S = SECONDS + 5, 4000
PERIOD_S = 0.1  # of each kind of call
ABOVE_S = 0.05
MORE_MISSED = 0.005
LIMITS = {"limits": ["calls_per_s = 100000"]}
FLOODS = {
    f"{count} connections, {kind}{', read' if reads else ''}": [
        "--connections", str(count), *(part for call in calls for part in ("--method", call)),
        *reads]
    for count in (250, 900) for kind, calls in (("calls", PLAIN), ("streams", streams()))
    for reads in ([], ["--reads"])}


class Operator:
    """Of one daemon. Keeps what each call took, s, from the time at which it was due."""

    def __init__(self, test):
        self.daemon = test.enterContext(Daemon(config=LIMITS))
        self.path = role_socket_path(self.daemon.socket, "operator")
        channel = test.enterContext(grpc.insecure_channel("unix:" + self.path))
        self.device = device_pb2_grpc.DeviceServiceStub(channel)
        render = render_pb2_grpc.RenderServiceStub(channel)
        change = render_pb2.UpdateSettingsRequest()
        change.settings.stiffness_n_per_mm = 0.5
        change.update_mask.paths.append("stiffness_n_per_mm")
        self.calls = {
            "GetDevice": (self.device.GetDevice, device_pb2.GetDeviceRequest()),
            "UpdateSettings": (render.UpdateSettings, change),
            "DisableForces": (self.device.DisableForces, device_pb2.DisableForcesRequest()),
            "StopForces": (self.device.StopForces, device_pb2.StopForcesRequest())}

    def begin(self):
        self.taken = {name: [] for name in (*self.calls, "the stop's socket")}
        self.failures = []
        self.before = self.servo()

    def servo(self):
        return self.device.GetDevice(device_pb2.GetDeviceRequest(), timeout=PATIENCE_S).servo

    def ask_all(self, due):
        for name, (method, request) in self.calls.items():
            call = method.future(request, timeout=PATIENCE_S)
            call.add_done_callback(lambda done, name=name: self.note(name, due, done))
        threading.Thread(target=self.stop, args=(due,)).start()

    def note(self, name, due, done):
        self.taken[name].append(time.monotonic() - due)
        if done.code() != grpc.StatusCode.OK:
            self.failures.append(f"{name}: {done.details()}")

    def stop(self, due):
        if stop_by_socket(stop_socket_path(self.path)) is None:
            self.failures.append("no answer at the stop's socket")
        self.taken["the stop's socket"].append(time.monotonic() - due)

    def is_answered(self, times):
        return all(len(taken) == times for taken in self.taken.values())

    def missed(self):
        now = self.servo()
        return (now.missed_ticks - self.before.missed_ticks) / (now.ticks - self.before.ticks)


class RoleTimes(unittest.TestCase):
    def check(self, name, options):
        both = [self.operator, self.control]
        flood = subprocess.Popen(
            [sys.executable, pathlib.Path(__file__).with_name("flood.py"),
             role_socket_path(self.operator.daemon.socket, "viewer"), str(FLOOD_S),
             "--per-s", str(PER_S), *options], stdout=subprocess.PIPE, text=True)
        self.addCleanup(flood.stdout.close)
        self.addCleanup(flood.kill)
        self.assertEqual(flood.stdout.readline(), "ready\n")
        for one in both:
            one.begin()
        began = time.monotonic()
        times = int(SECONDS / PERIOD_S)
        for n in range(times):
            for k, one in enumerate(both):
                due = began + PERIOD_S * (n + k / 2)
                time.sleep(max(0.0, due - time.monotonic()))
                one.ask_all(due)
        while not all(one.is_answered(times) for one in both):
            self.assertLess(time.monotonic() - began, 2 * SECONDS, name)
            time.sleep(0.1)
        missed, as_control = (one.missed() for one in both)
        self.assertIsNone(flood.poll(), "it ended too soon")
        sent = int(flood.stdout.read().split()[0])
        self.assertGreater(sent, 0.8 * PER_S * FLOOD_S, "it was no flood")
        self.assertEqual(self.operator.failures + self.control.failures, [], name)
        print(f"{name}: {100 * missed:.3f} % of the ticks missed, control {100 * as_control:.3f} %")
        for call, taken in self.operator.taken.items():
            (median, p99), (median_of_control, p99_of_control) = (
                (statistics.median(one), sorted(one)[len(one) * 99 // 100])
                for one in (taken, self.control.taken[call]))
            print(f"  {call}: median {1e3 * median:.1f} ms, p99 {1e3 * p99:.1f}, worst "
                  f"{1e3 * max(taken):.0f}; control {1e3 * median_of_control:.1f}, "
                  f"{1e3 * p99_of_control:.1f}", flush=True)
            self.assertLess(median, median_of_control + ABOVE_S, (name, call))
            self.assertLess(p99, p99_of_control + ABOVE_S, (name, call))
        self.assertLess(missed, 2 * as_control + MORE_MISSED, name)

    def test_beside_floods_of_viewers(self):
        self.enterContext(stolen_share())
        self.operator, self.control = Operator(self), Operator(self)
        for name, options in FLOODS.items():
            self.check(name, options)


if __name__ == "__main__":
    unittest.main()
