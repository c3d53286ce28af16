"""Clients that never read their answers hold nothing that others need."""

import contextlib
import itertools
import socket
import time
import unittest

import grpc

import palpate
from palpate.v1 import (device_pb2, device_pb2_grpc, recording_pb2, registration_pb2, render_pb2,
                        render_pb2_grpc, series_pb2, volume_pb2)
from secured import SecuredDaemon, stop_forces, wait_for
from support import PATIENCE_S, Daemon
from wire import DATA, GET_DEVICE, Deaf, Unreading, frame

CONNECTIONS = 4
CALLS = 100  # on each connection, which allows no more at once
LEAD_HAND = b"/palpate.v1.DeviceService/LeadHand"
HANDS = 8  # calls that lead the hand, or wait for it, of one identity
MANY_CALLS = "[limits]\ncalls_per_s = 100000\n"
FILES = (device_pb2, recording_pb2, registration_pb2, render_pb2, series_pb2, volume_pb2)


def plain_methods():
    """Every method of one request and one answer."""
    return [f"/{service.full_name}/{method.name}"
            for file in FILES for service in file.DESCRIPTOR.services_by_name.values()
            for method in service.methods
            if not method.client_streaming and not method.server_streaming]


def over_tls(daemon, role):
    plain = socket.create_connection(("127.0.0.1", daemon.port), timeout=PATIENCE_S)
    return Unreading(daemon.tls().wrap_socket(plain, server_hostname="localhost"),
                     daemon.tokens[role])


def known_over_tls(daemon, role):
    """A stranger's connection would be cut off for what it sends before its first answer."""
    attacker = over_tls(daemon, role)
    attacker.become_known(daemon.tokens[role])
    return attacker


def over_loopback(daemon):
    return Unreading(socket.create_connection(("127.0.0.1", daemon.port), timeout=PATIENCE_S))


def attack(stack, connect, method):
    for _ in range(CONNECTIONS):
        attacker = stack.enter_context(contextlib.closing(connect()))
        attacker.call(method.encode(), CALLS, first=3)


def ask(method, request):
    """Again where the attackers' questions have taken their identity's share of the processor: on a
    slow machine they do."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            return method(request, timeout=PATIENCE_S)
        except grpc.RpcError as refused:
            if "ask less often" not in refused.details() or time.monotonic() > end:
                raise
            time.sleep(0.1)


class Unread(unittest.TestCase):
    def check_honest(self, channel):
        """Of the identity of the attackers. More calls than the daemon has threads for them."""
        device = device_pb2_grpc.DeviceServiceStub(channel)
        render = render_pb2_grpc.RenderServiceStub(channel)
        for _ in range(5):
            ask(device.GetDevice, device_pb2.GetDeviceRequest())
            ask(render.GetSettings, render_pb2.GetSettingsRequest())
            stop_forces(channel)

    def check_every_method(self, connect, open_channel):
        methods = plain_methods()
        self.assertGreater(len(methods), 15)
        for method in methods:
            with self.subTest(method), contextlib.ExitStack() as stack:
                attack(stack, connect, method)
                self.check_honest(stack.enter_context(open_channel()))

    def test_a_stop_is_answered_whatever_its_connection_leaves_unread(self):
        with Daemon(listen=True) as daemon, \
                contextlib.closing(over_loopback(daemon)) as attacker:
            attacker.call(GET_DEVICE, 20)

            def ask(path, stream):
                attacker.call(path, 1, first=stream)
                return attacker.answer_of(stream)

            streams = itertools.count(41, 2)
            # After a second, others are refused.
            wait_for(lambda: not ask(GET_DEVICE, next(streams)), "a refusal")
            stopped = device_pb2.StopForcesResponse.FromString(
                ask(b"/palpate.v1.DeviceService/StopForces", next(streams))[5:])
            self.assertEqual(stopped.forces.state, device_pb2.FORCE_STATE_STOPPED)

    def test_every_method_over_tls(self):
        with SecuredDaemon(MANY_CALLS) as daemon:
            self.check_every_method(lambda: known_over_tls(daemon, "admin"),
                                    lambda: daemon.channel(daemon.tokens["admin"]))

    def test_every_method_over_loopback(self):
        with Daemon(listen=True, config={"limits": ["calls_per_s = 100000"]}) as daemon:
            self.check_every_method(
                lambda: over_loopback(daemon),
                lambda: grpc.insecure_channel(f"127.0.0.1:{daemon.port}"))

    def test_who_reads_nothing_gets_no_more_on_that_connection(self):
        with SecuredDaemon(MANY_CALLS) as daemon, contextlib.ExitStack() as stack:
            attacker = stack.enter_context(contextlib.closing(over_tls(daemon, "viewer")))
            attacker.call(b"/palpate.v1.VolumeService/GetVolume", CALLS // 2)
            time.sleep(1.5)  # longer than the daemon's patience
            attacker.call(b"/palpate.v1.VolumeService/GetVolume", CALLS // 2, first=CALLS + 1)
            # A refusal needs no window.
            attacker.read_until(b"answers wait to be read")
            self.check_honest(stack.enter_context(daemon.channel(daemon.tokens["viewer"])))

    def test_who_reads_not_even_refusals_is_cut_off(self):
        def deaf(daemon):
            plain = socket.socket()
            plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            plain.connect(("127.0.0.1", daemon.port))
            return Deaf(daemon.tls().wrap_socket(plain, server_hostname="localhost"),
                        daemon.tokens["viewer"])

        with SecuredDaemon(MANY_CALLS) as daemon, \
                contextlib.closing(deaf(daemon)) as attacker, self.assertRaises(OSError):
            for n in range(10000):
                attacker.call(b"/palpate.v1.VolumeService/GetVolume", 1, first=2 * n + 1)
                time.sleep(0.001)
        self.assertTrue(any("cut off" in line for line in daemon.said), daemon.said)

    def test_who_led_the_hand_and_reads_nothing_keeps_no_place(self):
        target = device_pb2.LeadHandRequest()
        target.target_mm.x = 1.0
        message = target.SerializeToString()
        with SecuredDaemon() as daemon, contextlib.ExitStack() as stack, \
                daemon.connect() as local:
            for _ in range(HANDS):
                attacker = stack.enter_context(contextlib.closing(over_tls(daemon, "operator")))
                attacker.begin_call(1, is_whole=True, more=attacker.more, path=LEAD_HAND)
                attacker.send(frame(DATA, 0, 1,
                                    b"\0" + len(message).to_bytes(4, "big") + message))
                wait_for(lambda: local.device.info().hand_led_by, "the hand to be led")
                wait_for(lambda: not local.device.info().hand_led_by, "the end of silence")
            conn = stack.enter_context(palpate.connect(
                daemon.address, tls_ca=str(daemon.authority.ca),
                token_file=str(daemon.tokens["operator"])))
            conn.device.lead((0, 10, 0)).close()


if __name__ == "__main__":
    unittest.main()
