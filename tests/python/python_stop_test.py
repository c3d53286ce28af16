"""The emergency stop gets through whatever other clients hold of the daemon."""

import contextlib
import os
import pathlib
import subprocess
import threading
import unittest

import grpc

import palpate
from palpate._stop_socket import stop_socket_path
from palpate.v1 import (device_pb2, device_pb2_grpc, edit_pb2, pose_pb2, pose_pb2_grpc,
                        volume_pb2, volume_pb2_grpc, volume_stream_pb2)
from secured import SecuredDaemon, stop_forces, wait_for
from support import PATIENCE_S

# More than the daemon has threads for calls.
CROWD = 300
STOPS = 20


class StopTest(unittest.TestCase):
    def start(self, volume):
        self.daemon = self.enterContext(SecuredDaemon(volume=volume))
        self.stack = self.enterContext(contextlib.ExitStack())
        self.ended = threading.Event()
        self.addCleanup(self.ended.set)

    def channel(self, role):
        """On a connection of its own."""
        return self.stack.enter_context(self.daemon.channel(
            self.daemon.tokens[role], options=[("grpc.use_local_subchannel_pool", 1)]))

    def check_stops(self):
        """From a client that is there, and from new ones, while the crowd is there."""
        early = self.channel("operator")
        for n in range(STOPS):
            channel = early if n % 5 else self.channel("viewer")
            self.assertEqual(stop_forces(channel).forces.state, device_pb2.FORCE_STATE_STOPPED)

    def hold(self, open_stream, request):
        """So many streams that answered once, whoever lets them."""
        channels = [self.channel(role) for role in ("viewer", "editor", "operator", "admin")]

        def requests():
            yield request
            self.ended.wait()

        held = [open_stream(channels[n % 4])(requests()) for n in range(CROWD)]
        self.stack.callback(lambda: [call.cancel() for call in held])
        answers = []

        def first(call):
            try:
                next(call)
                answers.append(grpc.StatusCode.OK)
            except grpc.RpcError as refused:
                answers.append(refused.code())

        for call in held:
            threading.Thread(target=first, args=(call,), daemon=True).start()
        wait_for(lambda: len(answers) == CROWD, "answers to the crowd")
        return answers

    def test_its_threads_go_before_others(self):
        self.start("builtin:sphere:16")
        may = subprocess.run(["sh", "-c", "renice -n -5 -p $$"], capture_output=True)
        urgent = -5 if may.returncode == 0 else 0
        expected = {"nexting_thread": {urgent}, "default-executo": {urgent},
                    "palpate-call": {0}, "palpate-pump": {0}}

        def nices():
            found = {name: set() for name in expected}
            for task in pathlib.Path(f"/proc/{self.daemon.pid}/task").iterdir():
                with contextlib.suppress(OSError, KeyError):  # it has ended, or is another one
                    found[(task / "comm").read_text().strip()].add(
                        os.getpriority(os.PRIO_PROCESS, int(task.name)))
            return found

        self.check_stops()
        self.daemon.ticks()  # a call that is worked on
        wait_for(lambda: all(nices().values()), "threads of each kind")
        self.assertEqual(nices(), expected)

    def test_it_goes_by_its_own_socket_and_connection(self):
        self.start("builtin:sphere:16")
        with palpate.connect(self.daemon.socket) as conn:
            self.assertEqual(conn.device.stop().state, "stopped")
            own = f"by local socket, user {os.getuid()}, process {os.getpid()}"
            wait_for(lambda: any(own in line for line in self.daemon.said), "the log")
            os.unlink(stop_socket_path(self.daemon.socket))  # as with one of the last release
            conn.device.enable()
            self.assertEqual(conn.device.stop().reason, "stop-call")
            self.assertEqual(conn.device.info().forces_set_by, "local socket")
            self.assertEqual(sum(own in line for line in self.daemon.said), 1)
        remote = self.enterContext(palpate.connect(
            self.daemon.address, tls_ca=self.daemon.authority.ca,
            token_file=self.daemon.tokens["viewer"]))

        def connections():
            table = pathlib.Path("/proc/net/tcp").read_text().splitlines()[1:]
            here = f"0100007F:{self.daemon.port:04X}"
            return sum(row.split()[1] == here and row.split()[3] == "01" for row in table)

        wait_for(lambda: connections() == 2, "a connection for the stop alone")
        self.assertEqual(remote.device.stop().state, "stopped")
        self.assertEqual(connections(), 2)

    def test_while_viewers_stream(self):
        self.start("builtin:sphere:16")
        start = pose_pb2.StreamPosesRequest()
        start.start.rate_hz = 20
        self.assertIn(grpc.StatusCode.OK,
                      self.hold(lambda c: pose_pb2_grpc.PoseServiceStub(c).StreamPoses, start))
        start = volume_stream_pb2.StreamVolumeRequest()
        start.start.SetInParent()
        self.hold(lambda c: volume_pb2_grpc.VolumeServiceStub(c).StreamVolume, start)
        self.check_stops()

    def test_while_edits_queue_up(self):
        self.start("builtin:sphere:128")

        def edit(operation, radius, value=None):
            request = edit_pb2.EditVolumeRequest(frame=edit_pb2.EDIT_FRAME_INDEX, value=value,
                                                 operation=operation)
            request.sphere.radius = radius
            request.sphere.center.x = request.sphere.center.y = request.sphere.center.z = 64
            return request

        stubs = [volume_pb2_grpc.VolumeServiceStub(self.channel("editor")) for _ in range(4)]
        before = stubs[0].GetVolume(volume_pb2.GetVolumeRequest(),
                                    timeout=PATIENCE_S).volume.volume_revision
        smooth = edit(edit_pb2.EDIT_OPERATION_SMOOTH, 50)
        calls = [stubs[n % 4].EditVolume.future(smooth) for n in range(CROWD)]
        self.stack.callback(lambda: [call.cancel() for call in calls])
        wait_for(lambda: any(call.done() for call in calls), "an edit")
        self.check_stops()
        # One client's queue keeps nobody else's calls out.
        operator = self.channel("operator")
        device_pb2_grpc.DeviceServiceStub(operator).GetDevice(device_pb2.GetDeviceRequest(),
                                                              timeout=PATIENCE_S)
        self.assertGreater(sum(not call.done() for call in calls), 0, "the crowd is still there")
        # Nothing is made of what was cancelled. Else a daemon that ends would first make what
        # nobody waits for, one after the other.
        for call in calls:
            call.cancel()
        made = volume_pb2_grpc.VolumeServiceStub(operator).EditVolume(
            edit(edit_pb2.EDIT_OPERATION_SUBTRACT, 2, 0.1),
            timeout=PATIENCE_S).volume_revision - before - 1
        answered = sum(not call.cancelled() and call.code() == grpc.StatusCode.OK
                       for call in calls)
        # One is under way, and some end while they are cancelled.
        self.assertLess(made - answered, CROWD / 4)
