"""Strangers who attack gRPC itself, before it asks who calls: they are cut off, and nobody else
notices. And what a known client may send. The bounds themselves, and who goes first in a crowd, are
connection_door_test's and security_limits_test's."""

import concurrent.futures
import contextlib
import os
import socket
import threading
import time
import unittest

import grpc
import numpy as np

import palpate
from palpate.v1 import device_pb2, device_pb2_grpc
from secured import SecuredDaemon, stop_forces, wait_for
from support import PATIENCE_S
from wire import CONTINUATION, DATA, END_STREAM, Stranger, frame, header

MIB = 1 << 20
ATTACKS = 3
FAR_BEYOND = 4096 * MIB


def endless_headers(stranger, most_bytes):
    stranger.begin_call(3, is_whole=False)
    piece = frame(CONTINUATION, 0, 3, header(b"x-more", b"m" * 100) * 140)
    while stranger.sent_bytes < most_bytes:
        stranger.send(piece)


def endless_messages(stranger, most_bytes):
    """Of 100 calls at once, whatever windows the daemon gives."""
    for call in range(100):
        stranger.begin_call(2 * call + 3, is_whole=True)
        # A message of 4 MB begins.
        stranger.send(frame(DATA, 0, 2 * call + 3, b"\0" + (4_000_000).to_bytes(4, "big")))
    call = 0
    while stranger.sent_bytes < most_bytes:
        stranger.send(frame(DATA, 0, 2 * (call % 100) + 3, b"\0" * 16000))
        call += 1


class AttackTest(unittest.TestCase):
    """A daemon of its own for each test: the lines are counted."""

    def setUp(self):
        self.daemon = self.enterContext(SecuredDaemon())

    def said(self, what):
        return "".join(self.daemon.said).count(what)

    def attack(self, how, address, token=None, most_bytes=400 * MIB, patience_s=PATIENCE_S):
        """What it sent before it was cut off, and noticed."""
        stranger = Stranger(self.daemon, address)
        with contextlib.closing(stranger):
            if token is not None:
                stranger.become_known(token)
            # Its kernel may wait for a window that never comes.
            stranger.socket.settimeout(patience_s)
            try:
                how(stranger, most_bytes)
            except OSError:
                pass
        return stranger.sent_bytes

    def attack_in_turn(self, how):
        """From addresses of their own, each when the one before was cut off or gave up. The kernel
        of an attacker may notice a minute later: it waits for a window."""
        for n in range(ATTACKS):
            address = f"127.0.0.{2 + n}"

            def is_cut_off():
                return any("cut off" in line and f"ipv4:{address}:" in line
                           for line in self.daemon.said)

            stranger = Stranger(self.daemon, address)
            with concurrent.futures.ThreadPoolExecutor(1) as pool, contextlib.closing(stranger):
                attack = pool.submit(how, stranger, 400 * MIB)
                wait_for(lambda: is_cut_off() or attack.done(), "its end")
                with contextlib.suppress(OSError):
                    stranger.socket.shutdown(socket.SHUT_RDWR)
                self.assertIsInstance(attack.exception(), OSError)


class Strangers(AttackTest):
    def assert_cut_off(self, how):
        before = self.daemon.resident_bytes()
        self.attack_in_turn(how)
        # AddressSanitizer keeps what was freed for a while.
        if "PALPATE_SANITIZED" not in os.environ:
            # gRPC takes a moment to let go of what the last one sent.
            wait_for(lambda: self.daemon.resident_bytes() - before < 110 * MIB, "the memory")
        wait_for(lambda: self.said("it sent too much") == ATTACKS, "the lines")
        self.assertEqual(self.said("cut off ipv4:127.0.0.2:"), 1)

    def test_endless_headers_are_cut_off(self):
        self.assert_cut_off(endless_headers)

    def test_endless_messages_are_cut_off(self):
        self.assert_cut_off(endless_messages)

    def test_a_client_at_the_attackers_address_is_served(self):
        # As behind one NAT: the attacker comes again whenever it is cut off.
        end = threading.Event()

        def attack_on():
            while not end.is_set():
                with contextlib.suppress(OSError):
                    self.attack(endless_headers, "127.0.0.1", patience_s=10.0)

        def cut_off():
            return self.said("cut off ipv4:127.0.0.1:")

        before = most = self.daemon.resident_bytes()
        attacker = threading.Thread(target=attack_on)
        attacker.start()
        served = 0
        try:
            deadline_s = time.monotonic() + 5 * PATIENCE_S
            while served < 50 or cut_off() < 5:
                self.assertLess(time.monotonic(), deadline_s, "the attacker is not cut off")
                # Each on a connection of its own; the emergency stop, too.
                with self.daemon.channel(
                        token=self.daemon.tokens["viewer"],
                        options=[("grpc.use_local_subchannel_pool", 1)]) as channel:
                    stub = device_pb2_grpc.DeviceServiceStub(channel)
                    stub.GetDevice(device_pb2.GetDeviceRequest(), timeout=PATIENCE_S)
                    stop_forces(channel)
                served += 1
                most = max(most, self.daemon.resident_bytes())
        finally:
            end.set()
            attacker.join()
        if "PALPATE_SANITIZED" not in os.environ:
            self.assertLess(most - before, 150 * MIB)

    def test_headers_of_grpcs_own_do_not_end_it(self):
        # gRPC 1.51 aborts where it writes the first of them for a metadata processor.
        ticks = self.daemon.ticks()
        for name in (b"grpclb_client_stats", b"lb-token", b"lb-cost-bin", b"grpc-trace-bin",
                     b"grpc-tags-bin", b"grpc-server-stats-bin", b"grpc-previous-rpc-attempts",
                     b"grpc-retry-pushback-ms", b"grpc-status", b"grpc-message", b"host"):
            for value in (b"x", b"", b"1", b"\xff" * 8):
                # Until it says something of the call, or hangs up.
                with contextlib.closing(Stranger(self.daemon, "127.0.0.1")) as stranger, \
                        contextlib.suppress(OSError):
                    stranger.begin_call(1, is_whole=True, more=((name, value),))
                    stranger.send(frame(DATA, END_STREAM, 1, b""))
                    stranger.read_until(b"\x00\x00\x00\x01")
        self.assertGreater(self.daemon.ticks(), ticks)


class KnownAttackers(AttackTest):
    """An editor who made a call is not watched. gRPC itself ends its endless messages; nothing ends
    its endless headers but the operator, who makes it a stranger again."""

    def test_endless_headers_end_with_the_token(self):
        flooder = Stranger(self.daemon, "127.0.0.9")
        self.addCleanup(flooder.close)
        flooder.become_known(self.daemon.tokens["editor"])
        endless_headers(flooder, 20 * MIB)
        self.assertTrue(flooder.is_connected())
        self.daemon.revoke_token("editor")
        wait_for(lambda: not flooder.is_connected(), "the end of the connection")
        wait_for(lambda: self.said("cut off") == 1, "its line")

    def test_endless_messages_are_ended(self):
        before = self.daemon.resident_bytes()
        sent = self.attack(endless_messages, "127.0.0.2", self.daemon.tokens["editor"],
                           most_bytes=FAR_BEYOND)
        # gRPC drops what comes until it closes the connection.
        self.assertLess(sent, FAR_BEYOND)
        if "PALPATE_SANITIZED" not in os.environ:
            # gRPC takes a moment to let go of what was sent last.
            wait_for(lambda: self.daemon.resident_bytes() - before < 200 * MIB, "the memory")
        self.assertEqual(self.said("cut off"), 0)


class Known(unittest.TestCase):
    """Whoever has made a call may send what he likes in calls."""

    def test_uploads_far_beyond_the_bound_of_strangers(self):
        values = np.random.default_rng(1).random((128, 128, 128), dtype=np.float32)
        # Clients are told from strangers by their addresses, which are of two kinds.
        for host in ("127.0.0.1", "[::1]") if socket.has_ipv6 else ("127.0.0.1",):
            with SecuredDaemon(host=host) as daemon, \
                    palpate.connect(daemon.address, tls_ca=str(daemon.authority.ca),
                                    token_file=str(daemon.tokens["operator"])) as operator:
                for _ in range(2):
                    operator.volume.upload(values, (0.5, 0.5, 0.5))
                self.assertNotIn("cut off", "".join(daemon.said))

    def test_compressed_messages_are_refused(self):
        # They would count for more than was sent.
        with SecuredDaemon() as daemon, \
                daemon.channel(token=daemon.tokens["viewer"]) as channel:
            stub = device_pb2_grpc.DeviceServiceStub(channel)
            for compression in (grpc.Compression.Gzip, grpc.Compression.Deflate):
                with self.assertRaises(grpc.RpcError) as refused:
                    stub.ListDevices(device_pb2.ListDevicesRequest(), timeout=PATIENCE_S,
                                     compression=compression)
                self.assertEqual(refused.exception.code(), grpc.StatusCode.UNIMPLEMENTED)
            stub.ListDevices(device_pb2.ListDevicesRequest(), timeout=PATIENCE_S)


if __name__ == "__main__":
    unittest.main()
