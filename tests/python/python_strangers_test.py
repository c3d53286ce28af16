"""Strangers who attack gRPC itself, before it asks who calls: they are cut off, and nobody else
notices. And what a known client may send."""

import concurrent.futures
import contextlib
import os
import pathlib
import socket
import ssl
import tempfile
import threading
import time
import unittest

import grpc
import numpy as np

import palpate
from palpate.v1 import device_pb2, device_pb2_grpc
from excuse import busy_machine_may_explain
from secured import SecuredDaemon, frame, header, wait_for

MIB = 1 << 20
HEADERS, DATA, SETTINGS, CONTINUATION = 1, 0, 4, 9
END_HEADERS, END_STREAM = 4, 1
MOST_STRANGERS = 64
ATTACKS = 4
FAR_BEYOND = 4096 * MIB


class Stranger:
    """Speaks TLS and HTTP/2 from an address of its own, and follows none of its rules."""

    def __init__(self, daemon, address):
        context = ssl.create_default_context(cafile=str(daemon.authority.ca))
        context.set_alpn_protocols(["h2"])
        plain = socket.create_connection(("127.0.0.1", daemon.port), timeout=20.0,
                                         source_address=(address, 0))
        try:
            self.socket = context.wrap_socket(plain, server_hostname="localhost")
        except OSError:
            plain.close()
            raise
        self.sent_bytes = 0
        self.send(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + frame(SETTINGS, 0, 0, b""))

    def send(self, content):
        self.socket.sendall(content)
        self.sent_bytes += len(content)

    def become_known(self, token):
        """By a call of its own, whole and answered."""
        self.begin_call(1, is_whole=True, more=(
            (b"authorization", b"Bearer " + token.read_bytes().strip()),))
        self.send(frame(DATA, END_STREAM, 1, bytes(5)))
        self.socket.settimeout(20.0)
        answer = b""
        while b"grpc-status" not in answer:
            piece = self.socket.recv(65536)
            if not piece:
                raise OSError("no answer")
            answer += piece

    def begin_call(self, stream, is_whole, more=()):
        fields = [(b":method", b"POST"), (b":scheme", b"https"), (b":authority", b"localhost"),
                  (b":path", b"/palpate.v1.DeviceService/GetDevice"), (b"te", b"trailers"),
                  (b"content-type", b"application/grpc"), *more]
        self.send(frame(HEADERS, END_HEADERS if is_whole else 0, stream,
                        b"".join(header(*field) for field in fields)))

    def is_connected(self):
        self.socket.settimeout(0.0)
        try:
            while self.socket.recv(65536):
                pass
            return False
        except (ssl.SSLWantReadError, BlockingIOError):
            return True
        except OSError:
            return False

    def close(self):
        self.socket.close()


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


def resident_bytes(daemon):
    for line in pathlib.Path(f"/proc/{daemon.process.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) << 10
    raise AssertionError("no VmRSS")


class AttackTest(unittest.TestCase):
    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-python-"))
        self.daemon = self.enterContext(SecuredDaemon(self.folder))

    def said(self, what):
        return "".join(self.daemon.said).count(what)

    def attack(self, how, address, token=None, most_bytes=400 * MIB, patience_s=10.0):
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
        """From addresses of their own, each when the one before was cut off or gave up; an
        attacker may notice later. What each sent."""
        def is_cut_off(address):
            return any("cut off" in line and f"ipv4:{address}:" in line
                       for line in self.daemon.said)

        with concurrent.futures.ThreadPoolExecutor(ATTACKS) as pool:
            attacks = []
            for n in range(ATTACKS):
                address = f"127.0.0.{2 + n}"
                attacks.append(pool.submit(self.attack, how, address))
                wait_for(lambda: is_cut_off(address) or attacks[-1].done(), "its end")
            return [attack.result() for attack in attacks]


class Strangers(AttackTest):
    def assert_cut_off(self, how):
        before = resident_bytes(self.daemon)
        sent = self.attack_in_turn(how)
        print(f"{how.__name__}: cut off after {[n // MIB for n in sent]} MiB, "
              f"{(resident_bytes(self.daemon) - before) / MIB:.0f} MiB more held")
        # What is under way in the kernel comes on top of the 8 MiB: connection_door_test has
        # the bound itself.
        with busy_machine_may_explain():
            self.assertLess(max(sent), 200 * MIB)
        # AddressSanitizer keeps what was freed for a while.
        if "PALPATE_SANITIZED" not in os.environ:
            # gRPC takes a moment to let go of what the last one sent.
            wait_for(lambda: resident_bytes(self.daemon) - before < 150 * MIB, "the memory")
        wait_for(lambda: self.said("it sent too much without a call that it may make") == ATTACKS,
                 "the lines")
        self.assertEqual(self.said("cut off ipv4:127.0.0.2:"), 1)

    def test_endless_headers_are_cut_off(self):
        self.assert_cut_off(endless_headers)

    def test_endless_messages_are_cut_off(self):
        self.assert_cut_off(endless_messages)

    def stop_often(self, count):
        """Over TLS and on the socket; what each took, the shortest first."""
        taken = []
        with self.daemon.channel(token=self.daemon.tokens["viewer"]) as channel:
            for stub in (device_pb2_grpc.DeviceServiceStub(channel),
                         device_pb2_grpc.DeviceServiceStub(
                             grpc.insecure_channel(f"unix:{self.daemon.socket}"))):
                for _ in range(count):
                    began = time.monotonic()
                    stub.StopForces(device_pb2.StopForcesRequest(), timeout=20.0,
                                    wait_for_ready=True)
                    taken.append(time.monotonic() - began)
                    time.sleep(0.05)
        return sorted(taken)

    def test_the_emergency_stop_works_while_strangers_attack(self):
        alone = self.stop_often(10)
        end = threading.Event()

        def attack_on(address):
            while not end.is_set():
                try:
                    self.attack(endless_headers, address)
                except OSError:
                    time.sleep(0.01)  # cut off within its handshake

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
        print(f"100 emergency stops while ten strangers attack: median {attacked[50] * 1e3:.1f} ms, "
              f"p98 {attacked[97] * 1e3:.0f} ms; without, median "
              f"{alone[len(alone) // 2] * 1e3:.1f} ms; {self.said('it sent too much')} lines")
        # What else the machine does slows both.
        with busy_machine_may_explain():
            self.assertLess(attacked[50], 10 * alone[len(alone) // 2])
        with busy_machine_may_explain():
            self.assertLess(attacked[97], 2.0)
        with busy_machine_may_explain():
            self.assertGreater(self.said("it sent too much"), 9)

    def call_anew(self):
        """A call on a connection of its own."""
        with self.daemon.channel(token=self.daemon.tokens["viewer"],
                                 options=[("grpc.use_local_subchannel_pool", 1)]) as channel:
            device_pb2_grpc.DeviceServiceStub(channel).GetDevice(
                device_pb2.GetDeviceRequest(), timeout=20.0)

    def test_a_client_at_the_attackers_address_is_served(self):
        # As behind one NAT: the attacker comes again whenever it is cut off.
        end = threading.Event()
        sent = []

        def attack_on():
            while not end.is_set():
                with contextlib.suppress(OSError):
                    sent.append(self.attack(endless_headers, "127.0.0.1", patience_s=0.1))

        before = most = resident_bytes(self.daemon)
        attacker = threading.Thread(target=attack_on)
        attacker.start()
        waits = []
        try:
            while len(waits) < 200 or len(sent) < 20:
                began = time.monotonic()
                self.call_anew()
                waits.append(time.monotonic() - began)
                most = max(most, resident_bytes(self.daemon))
                self.assertLess(len(waits), 10_000)
        finally:
            end.set()
            attacker.join()
        print(f"{len(waits)} calls beside {len(sent)} attacks of {sum(sent) / MIB:.0f} MiB from one "
              f"address: median {sorted(waits)[len(waits) // 2] * 1e3:.1f} ms, most "
              f"{max(waits) * 1e3:.0f} ms, {(most - before) / MIB:.0f} MiB more held")
        self.assertGreaterEqual(self.said("cut off ipv4:127.0.0.1:"), 10)
        if "PALPATE_SANITIZED" not in os.environ:
            self.assertLess(most - before, 150 * MIB)

    def test_a_newcomer_gets_in_among_strangers_of_many_addresses(self):
        crowd = [Stranger(self.daemon, f"127.0.1.{n}") for n in range(1, MOST_STRANGERS + 1)]
        for one in crowd:
            self.addCleanup(one.close)
        # With its own address the first and the last of all, by any order of names.
        for address in ("127.0.0.1", "127.0.2.1"):
            newcomer = Stranger(self.daemon, address)
            self.addCleanup(newcomer.close)
            newcomer.become_known(self.daemon.tokens["viewer"])
            self.assertTrue(newcomer.is_connected())
        for _ in range(20):
            self.call_anew()
        self.assertGreater(self.said("too many are connected"), 0)

    def test_a_crowd_of_one_address_takes_only_its_own_places(self):
        early = Stranger(self.daemon, "127.0.0.3")
        self.addCleanup(early.close)
        crowd = []
        for _ in range(3 * MOST_STRANGERS):
            try:
                crowd.append(Stranger(self.daemon, "127.0.0.2"))
            except OSError:
                pass  # cut off within its handshake
        for one in crowd:
            self.addCleanup(one.close)
        wait_for(lambda: sum(one.is_connected() for one in crowd) < MOST_STRANGERS, "the cuts")
        self.assertTrue(early.is_connected())
        with palpate.connect(self.daemon.address, tls_ca=str(self.daemon.authority.ca),
                             token_file=str(self.daemon.tokens["viewer"])) as viewer:
            self.assertGreater(viewer.settings.isovalue, 0.0)
        self.assertGreater(self.said("too many are connected"), 0)


class KnownAttackers(AttackTest):
    """A client that made a call is not watched. gRPC itself ends its endless messages; nothing ends
    its endless headers but the operator."""

    def test_endless_headers_end_with_the_token(self):
        flooder = Stranger(self.daemon, "127.0.0.9")
        self.addCleanup(flooder.close)
        flooder.become_known(self.daemon.tokens["editor"])
        flooder.begin_call(3, is_whole=False)
        self.assertTrue(flooder.is_connected())
        self.daemon.revoke_token("editor")
        wait_for(lambda: not flooder.is_connected(), "the end of the connection")
        wait_for(lambda: self.said("its client is no longer allowed") == 1, "its line")

    def test_endless_messages_are_ended(self):
        before = resident_bytes(self.daemon)
        sent = [self.attack(endless_messages, f"127.0.0.{n}", self.daemon.tokens["viewer"],
                            most_bytes=FAR_BEYOND)
                for n in range(2, 2 + ATTACKS)]
        print(f"endless messages of a viewer: ended after {[n // MIB for n in sent]} MiB, "
              f"{(resident_bytes(self.daemon) - before) / MIB:.0f} MiB more held")
        # gRPC drops what comes until it closes the connection.
        self.assertLess(max(sent), FAR_BEYOND)
        if "PALPATE_SANITIZED" not in os.environ:
            # gRPC takes a moment to let go of what the last one sent.
            wait_for(lambda: resident_bytes(self.daemon) - before < 400 * MIB, "the memory")
        self.assertEqual(self.said("cut off"), 0)


class Known(unittest.TestCase):
    """Whoever has made a call may send what he likes in calls."""

    def upload(self, host):
        with tempfile.TemporaryDirectory(prefix="palpate-python-") as folder, \
                SecuredDaemon(folder, host=host) as daemon, \
                palpate.connect(daemon.address, tls_ca=str(daemon.authority.ca),
                                token_file=str(daemon.tokens["operator"])) as operator:
            values = np.random.default_rng(1).random((160, 160, 160), dtype=np.float32)
            for _ in range(3):
                operator.volume.upload(values, (0.5, 0.5, 0.5))
            self.assertNotIn("cut off", "".join(daemon.said))

    def test_uploads_far_beyond_the_bound_of_strangers(self):
        self.upload("127.0.0.1")

    @unittest.skipUnless(socket.has_ipv6, "no IPv6 here")
    def test_by_ipv6_too(self):
        self.upload("[::1]")

    def test_compressed_messages_are_refused(self):
        # They would count for more than was sent.
        with tempfile.TemporaryDirectory(prefix="palpate-python-") as folder, \
                SecuredDaemon(folder) as daemon, \
                daemon.channel(token=daemon.tokens["viewer"]) as channel:
            stub = device_pb2_grpc.DeviceServiceStub(channel)
            for compression in (grpc.Compression.Gzip, grpc.Compression.Deflate):
                with self.assertRaises(grpc.RpcError) as refused:
                    stub.ListDevices(device_pb2.ListDevicesRequest(), timeout=20.0,
                                     compression=compression)
                self.assertEqual(refused.exception.code(), grpc.StatusCode.UNIMPLEMENTED)
            stub.ListDevices(device_pb2.ListDevicesRequest(), timeout=20.0)


if __name__ == "__main__":
    unittest.main()
