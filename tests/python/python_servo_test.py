"""What strangers on the network take of the servo's time."""

import contextlib
import socket
import statistics
import tempfile
import unittest

import grpc

from palpate.v1 import device_pb2, device_pb2_grpc
from excuse import busy_machine_may_explain
from secured import SecuredDaemon, dawdle


class ServoTest(unittest.TestCase):
    def setUp(self):
        folder = self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-servo-"))
        self.daemon = SecuredDaemon(folder)
        self.addCleanup(self.daemon.end)

    def missed_share(self, what):
        """Of the servo's ticks while `what` runs."""
        def servo():
            return device_pb2_grpc.DeviceServiceStub(local).GetDevice(
                device_pb2.GetDeviceRequest(), timeout=20.0).servo

        with grpc.insecure_channel("unix:" + self.daemon.socket) as local:
            before = servo()
            what()
            after = servo()
        with busy_machine_may_explain():
            self.assertGreater(after.ticks - before.ticks, 300)
        return (after.missed_ticks - before.missed_ticks) / (after.ticks - before.ticks)

    def test_dawdlers_do_not_hinder_the_servo(self):
        # The same against the daemon and against nobody, by turns: only what it does to
        # the servo differs, whatever else this machine does.
        nobody = self.enterContext(socket.create_server(("127.0.0.1", 0), backlog=1000))
        shares = {self.daemon.port: [], nobody.getsockname()[1]: []}
        for _ in range(7):
            for port, missed in shares.items():
                with contextlib.ExitStack() as stack:
                    missed.append(self.missed_share(lambda: dawdle(stack, port)))
        attacked, quiet = (statistics.median(missed) for missed in shares.values())
        print(f"missed {attacked:.4f} of the ticks beside dawdlers, {quiet:.4f} without")
        with busy_machine_may_explain():
            self.assertLess(attacked, 2.0 * quiet + 0.01)


if __name__ == "__main__":
    unittest.main()
