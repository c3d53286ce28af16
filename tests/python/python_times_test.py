"""How long plain calls take beside a bare gRPC server's, and what strangers on the network take of
the servo's time: each by turns with what it is compared to."""

import concurrent.futures
import contextlib
import multiprocessing
import socket
import statistics
import tempfile
import time
import unittest

import grpc
import numpy as np

from palpate.v1 import device_pb2, device_pb2_grpc, render_pb2, render_pb2_grpc
from secured import SecuredDaemon, dawdle
from stolen import stolen_share
from support import Daemon

CALLS = 5000
# Below the daemon's bound of 2 000 per second for one client.
BETWEEN_CALLS_S = 0.0006
SLOW_MS = 20.0


class TimesTest(unittest.TestCase):
    def setUp(self):
        self.enterContext(stolen_share())


def serve_bare(path):
    """Answers each call with its own request."""
    server = grpc.server(concurrent.futures.ThreadPoolExecutor(1))
    handler = grpc.unary_unary_rpc_method_handler(lambda request, context: request)
    server.add_generic_rpc_handlers(
        (grpc.method_handlers_generic_handler("bare", {"Echo": handler}),))
    server.add_insecure_port(f"unix:{path}")
    server.start()
    server.wait_for_termination()


def taken_ms(call):
    start = time.perf_counter()
    call()
    taken_s = time.perf_counter() - start
    time.sleep(max(0.0, BETWEEN_CALLS_S - taken_s))
    return taken_s * 1e3


class Calls(TimesTest):
    def test_calls_do_not_stall(self):
        daemon = self.enterContext(Daemon())
        path = f"{daemon.folder}/bare.sock"
        # Not forked: gRPC has threads here.
        bare = multiprocessing.get_context("spawn").Process(target=serve_bare, args=(path,),
                                                            daemon=True)
        bare.start()
        self.addCleanup(bare.join)
        self.addCleanup(bare.kill)
        channel = self.enterContext(grpc.insecure_channel(f"unix:{path}"))
        grpc.channel_ready_future(channel).result(timeout=60)
        echo = channel.unary_unary("/bare/Echo")
        stub = render_pb2_grpc.RenderServiceStub(
            self.enterContext(grpc.insecure_channel(f"unix:{daemon.socket}")))
        request = render_pb2.GetSettingsRequest()
        calls = (lambda: stub.GetSettings(request), lambda: echo(b""))
        for call in calls:
            call()
        taken = np.array([[taken_ms(call) for call in calls] for _ in range(CALLS)])
        slow, slow_bare = (taken > SLOW_MS).sum(axis=0)
        p99, p99_bare = np.quantile(taken, 0.99, axis=0)
        print(f"daemon: p99 {p99:.2f} ms, greatest {taken[:, 0].max():.0f} ms, {slow} above "
              f"{SLOW_MS:g}; bare: {p99_bare:.2f}, {taken[:, 1].max():.0f}, {slow_bare}")
        self.assertLessEqual(slow, slow_bare + 2)
        self.assertLessEqual(p99, max(5.0, 2.0 * p99_bare))


class Strangers(TimesTest):
    def test_dawdlers_do_not_hinder_the_servo(self):
        folder = self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-servo-"))
        daemon = self.enterContext(SecuredDaemon(folder))
        local = device_pb2_grpc.DeviceServiceStub(
            self.enterContext(grpc.insecure_channel("unix:" + daemon.socket)))

        def missed_share(port):
            """Of the servo's ticks beside dawdlers at a port."""
            before = local.GetDevice(device_pb2.GetDeviceRequest(), timeout=20.0).servo
            with contextlib.ExitStack() as stack:
                dawdle(stack, port)
                after = local.GetDevice(device_pb2.GetDeviceRequest(), timeout=20.0).servo
            self.assertGreater(after.ticks - before.ticks, 300)
            return (after.missed_ticks - before.missed_ticks) / (after.ticks - before.ticks)

        # The same against the daemon and against nobody: only what it does to the servo differs.
        nobody = self.enterContext(socket.create_server(("127.0.0.1", 0), backlog=1000))
        shares = {daemon.port: [], nobody.getsockname()[1]: []}
        for _ in range(7):
            for port, missed in shares.items():
                missed.append(missed_share(port))
        attacked, quiet = (statistics.median(missed) for missed in shares.values())
        print(f"missed {attacked:.4f} of the ticks beside dawdlers, {quiet:.4f} without")
        self.assertLess(attacked, 2.0 * quiet + 0.01)


if __name__ == "__main__":
    unittest.main()
