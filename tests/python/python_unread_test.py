"""Clients that never read their answers hold nothing that others need."""

import contextlib
import socket
import unittest

import grpc

from palpate.v1 import (device_pb2, device_pb2_grpc, recording_pb2, registration_pb2, render_pb2,
                        render_pb2_grpc, series_pb2, volume_pb2)
from secured import SecuredDaemon, stop_forces, wait_for
from support import PATIENCE_S, Daemon
from wire import Unreading

CONNECTIONS = 4
CALLS = 100  # on each connection, which allows no more at once
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


def over_loopback(daemon):
    return Unreading(socket.create_connection(("127.0.0.1", daemon.port), timeout=PATIENCE_S))


def attack(stack, connect, method):
    for _ in range(CONNECTIONS):
        attacker = stack.enter_context(contextlib.closing(connect()))
        attacker.call(method.encode(), CALLS)


class Unread(unittest.TestCase):
    def check_honest(self, channel):
        """Of the identity of the attackers. More calls than the daemon has threads for them."""
        for _ in range(5):
            device_pb2_grpc.DeviceServiceStub(channel).GetDevice(
                device_pb2.GetDeviceRequest(), timeout=PATIENCE_S)
            render_pb2_grpc.RenderServiceStub(channel).GetSettings(
                render_pb2.GetSettingsRequest(), timeout=PATIENCE_S)
            stop_forces(channel)

    def check_every_method(self, connect, open_channel):
        methods = plain_methods()
        self.assertGreater(len(methods), 15)
        for method in methods:
            with self.subTest(method), contextlib.ExitStack() as stack:
                attack(stack, connect, method)
                self.check_honest(stack.enter_context(open_channel()))

    def test_every_method_over_tls(self):
        with SecuredDaemon(MANY_CALLS) as daemon:
            self.check_every_method(lambda: over_tls(daemon, "admin"),
                                    lambda: daemon.channel(daemon.tokens["admin"]))

    def test_every_method_over_loopback(self):
        with Daemon(listen=True, config={"limits": ["calls_per_s = 100000"]}) as daemon:
            self.check_every_method(
                lambda: over_loopback(daemon),
                lambda: grpc.insecure_channel(f"127.0.0.1:{daemon.port}"))

    def test_unread_answers_are_dropped_after_ten_seconds(self):
        with SecuredDaemon(MANY_CALLS) as daemon, contextlib.ExitStack() as stack:
            attack(stack, lambda: over_tls(daemon, "viewer"),
                   "/palpate.v1.VolumeService/GetVolume")
            wait_for(lambda: any("does not read" in line for line in daemon.said),
                     "the end of a call")
            self.check_honest(stack.enter_context(daemon.channel(daemon.tokens["viewer"])))


if __name__ == "__main__":
    unittest.main()
