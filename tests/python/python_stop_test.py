"""The emergency stop gets through whatever other clients hold of the daemon."""

import contextlib
import os
import tempfile
import threading
import time
import unittest

import grpc

from palpate.v1 import (device_pb2, device_pb2_grpc, edit_pb2, pose_pb2, pose_pb2_grpc,
                        volume_pb2, volume_pb2_grpc, volume_stream_pb2)
from excuse import busy_machine_may_explain
from secured import SecuredDaemon, wait_for
from support import PATIENCE_S

# More than the daemon has threads for calls.
CROWD = 400
STOPS = 50


class StopTest(unittest.TestCase):
    def setUp(self):
        folder = self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-stop-"))
        self.daemon = self.enterContext(SecuredDaemon(folder, volume="builtin:sphere:256"))
        self.stack = self.enterContext(contextlib.ExitStack())
        self.ended = threading.Event()
        self.addCleanup(self.ended.set)
        self.waits_alone = self.wait_of_stops()

    def channel(self, role):
        """On a connection of its own."""
        return self.stack.enter_context(self.daemon.channel(
            self.daemon.tokens[role], options=[("grpc.use_local_subchannel_pool", 1)]))

    def wait_of_stops(self):
        """Calls the stop from a client that is there, and from new ones; the times, in order."""
        waits = []
        early = self.channel("operator")
        for n in range(STOPS):
            channel = early if n % 5 else self.channel("viewer")
            began = time.monotonic()
            answer = device_pb2_grpc.DeviceServiceStub(channel).StopForces(
                device_pb2.StopForcesRequest(), timeout=20.0)
            waits.append(time.monotonic() - began)
            self.assertEqual(answer.forces.state, device_pb2.FORCE_STATE_STOPPED)
        return sorted(waits)

    def check_stops(self, crowd):
        """While the crowd is there."""
        waits = self.wait_of_stops()
        p98 = waits[-2]
        print(f"{crowd}: stops wait {1e3 * waits[STOPS // 2]:.1f} ms, p98 {1e3 * p98:.1f} ms; "
              f"alone {1e3 * self.waits_alone[STOPS // 2]:.1f} ms", flush=True)
        # A person's reaction takes 0.2 s; the machine may be busy with other tests.
        with busy_machine_may_explain():
            self.assertLess(p98, 2.0)

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

    def test_while_viewers_stream(self):
        start = pose_pb2.StreamPosesRequest()
        start.start.rate_hz = 20
        self.assertIn(grpc.StatusCode.OK,
                      self.hold(lambda c: pose_pb2_grpc.PoseServiceStub(c).StreamPoses, start))
        start = volume_stream_pb2.StreamVolumeRequest()
        start.start.SetInParent()
        self.hold(lambda c: volume_pb2_grpc.VolumeServiceStub(c).StreamVolume, start)
        self.check_stops("viewers")

    def test_while_edits_queue_up(self):
        request = edit_pb2.EditVolumeRequest(frame=edit_pb2.EDIT_FRAME_INDEX,
                                             operation=edit_pb2.EDIT_OPERATION_SMOOTH)
        request.sphere.radius = 100
        request.sphere.center.x = request.sphere.center.y = request.sphere.center.z = 128
        channels = [self.channel("editor") for _ in range(4)]
        self.revision = volume_pb2_grpc.VolumeServiceStub(channels[0]).GetVolume(
            volume_pb2.GetVolumeRequest(), timeout=20.0).volume.volume_revision
        calls = [volume_pb2_grpc.VolumeServiceStub(channels[n % 4]).EditVolume.future(request)
                 for n in range(CROWD)]
        self.stack.callback(lambda: [call.cancel() for call in calls])
        tasks = f"/proc/{self.daemon.process.pid}/task"
        wait_for(lambda: len(os.listdir(tasks)) > 60, "threads at work")
        self.check_stops("edits")
        # One client's queue keeps nobody else's calls out.
        device_pb2_grpc.DeviceServiceStub(self.channel("operator")).GetDevice(
            device_pb2.GetDeviceRequest(), timeout=20.0)
        self.assertGreater(sum(not call.done() for call in calls), 0, "the crowd is still there")
        self.check_nothing_is_made_of_the_cancelled(calls, self.channel("operator"))

    def check_nothing_is_made_of_the_cancelled(self, calls, channel):
        """Or a daemon that ends would first make what nobody waits for, one after the other."""
        for call in calls:
            call.cancel()
        small = edit_pb2.EditVolumeRequest(frame=edit_pb2.EDIT_FRAME_INDEX,
                                           operation=edit_pb2.EDIT_OPERATION_SUBTRACT, value=0.1)
        small.sphere.radius = 2
        small.sphere.center.x = small.sphere.center.y = small.sphere.center.z = 128
        made = volume_pb2_grpc.VolumeServiceStub(channel).EditVolume(
            small, timeout=PATIENCE_S).volume_revision - self.revision - 1
        answered = sum(not call.cancelled() and call.code() == grpc.StatusCode.OK
                       for call in calls)
        print(f"edits: {made} made, {answered} answered", flush=True)
        # One is under way, and some end while they are cancelled.
        with busy_machine_may_explain():
            self.assertLessEqual(made, answered + 10)


if __name__ == "__main__":
    unittest.main()
