"""TLS peers that vanish, in the handshake and after it: found out, closed, forgotten."""

import contextlib
import os
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import unittest

from palpate.v1 import pose_pb2, pose_pb2_grpc
from secured import SecuredDaemon, wait_for

# A client that streams until it is stopped: then its connection is there, and nobody
# answers any more.
CHILD = """
import sys, threading, grpc
from palpate.v1 import pose_pb2, pose_pb2_grpc
address, ca, token = sys.argv[1:]
tls = grpc.composite_channel_credentials(
    grpc.ssl_channel_credentials(open(ca, 'rb').read()),
    grpc.access_token_call_credentials(open(token).read().strip()))
start = pose_pb2.StreamPosesRequest()
start.start.rate_hz = 1000
start.start.batch = 10
def requests():
    yield start
    threading.Event().wait()
streams = []
for n in range(4):
    channel = grpc.secure_channel(address, tls, options=[('grpc.use_local_subchannel_pool', 1)])
    streams.append(pose_pb2_grpc.PoseServiceStub(channel).StreamPoses(requests()))
    next(streams[-1])
print('streaming', flush=True)
for answer in streams[0]:
    pass
"""


class HalfOpenTest(unittest.TestCase):
    def setUp(self):
        folder = self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-half-open-"))
        self.daemon = self.enterContext(SecuredDaemon(folder))
        self.good = self.enterContext(self.daemon.channel(self.daemon.tokens["viewer"]))
        self.stream = self.follow(self.good)
        self.files = self.open_files()

    def follow(self, channel):
        done = threading.Event()
        self.addCleanup(done.set)

        def requests():
            request = pose_pb2.StreamPosesRequest()
            request.start.rate_hz = 60
            yield request
            done.wait()

        stream = pose_pb2_grpc.PoseServiceStub(channel).StreamPoses(requests(), timeout=300.0)
        next(stream)
        return stream

    def open_files(self):
        return len(os.listdir(f"/proc/{self.daemon.process.pid}/fd"))

    def check_recovery(self):
        """Their files come back, the good client saw nothing, and others get in."""
        wait_for(lambda: self.open_files() <= self.files, f"{self.files} files", 120.0)
        for _ in range(60):
            next(self.stream)
        with self.daemon.channel(self.daemon.tokens["viewer"]) as late:
            self.follow(late).cancel()

    def begin(self, sent, answers):
        """A handshake of which the daemon gets the first `sent` bytes of each message, so
        many times."""
        context = ssl.create_default_context(cafile=str(self.daemon.authority.ca))
        context.set_alpn_protocols(["h2"])
        incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        tls = context.wrap_bio(incoming, outgoing, server_hostname="localhost")
        plain = self.enterContext(socket.create_connection(("127.0.0.1", self.daemon.port)))
        plain.settimeout(20.0)
        for _ in range(answers):
            with contextlib.suppress(ssl.SSLWantReadError):
                tls.do_handshake()
            plain.sendall(outgoing.read()[:sent])
            if sent is None:
                incoming.write(plain.recv(65536))
        return plain

    def test_handshakes_that_stop(self):
        whole = None
        held = [self.begin(sent, answers) for _ in range(10)
                for sent, answers in ((0, 1), (1, 1), (100, 1), (whole, 1), (whole, 2))]
        wait_for(lambda: self.open_files() >= self.files + len(held), "all of them")
        self.check_recovery()

    def test_streams_whose_client_stops(self):
        child = subprocess.Popen(
            [sys.executable, "-c", CHILD, self.daemon.address, str(self.daemon.authority.ca),
             str(self.daemon.tokens["viewer"])], stdout=subprocess.PIPE, text=True)
        self.addCleanup(child.stdout.close)
        self.addCleanup(child.wait)
        self.addCleanup(child.kill)
        self.assertEqual(child.stdout.readline().strip(), "streaming")
        self.assertGreaterEqual(self.open_files(), self.files + 4)
        child.send_signal(signal.SIGSTOP)
        self.check_recovery()
        self.assertIsNone(child.poll())


if __name__ == "__main__":
    unittest.main()
