"""Attacks on a palpated with TLS, over real sockets; and what those who may, may."""

import contextlib
import os
import resource
import socket
import ssl
import subprocess
import threading
import unittest

import grpc

import palpate
from palpate.v1 import device_pb2, pose_pb2, pose_pb2_grpc, render_pb2, render_pb2_grpc
from authority import Authority
from secured import ROLES, SecuredDaemon, dawdle, stop_forces, wait_for
from support import METHODS, PALPATE, PATIENCE_S, bare_call

ENABLE, STOP = (device_pb2.DESCRIPTOR.services_by_name["DeviceService"].methods_by_name[name]
                for name in ("EnableForces", "StopForces"))
# That may stay without a call.
STRANGERS = 64
# Far more than all of them, as far as this process may open so many.
FLOOD = min(2000, resource.getrlimit(resource.RLIMIT_NOFILE)[0] - 200)


def call(channel, method, metadata=None):
    """Calls any method with an empty request; the status code and its line."""
    request = iter([b""]) if method.client_streaming else b""
    try:
        answer = bare_call(channel, method)(request, timeout=PATIENCE_S, metadata=metadata)
        if method.server_streaming:
            next(iter(answer), None)
            answer.cancel()
        return grpc.StatusCode.OK, ""
    except grpc.RpcError as failed:
        return failed.code(), failed.details()


class PoseStreams:
    """Streams of poses whose client says nothing more, until the test ends. `start`: what its
    start says, if not 60 Hz."""

    def __init__(self, test):
        self._done = threading.Event()
        test.addCleanup(self._done.set)

    def begin(self, channel, metadata=None, **start):
        def requests():
            yield pose_pb2.StreamPosesRequest(
                start=pose_pb2.StreamPosesStart(**{"rate_hz": 60, **start}))
            self._done.wait()

        stream = pose_pb2_grpc.PoseServiceStub(channel).StreamPoses(requests(), metadata=metadata)
        next(stream)
        return stream


class SecuredTest(unittest.TestCase):
    """One daemon for all tests of a class."""

    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(SecuredDaemon())

    def said(self, *parts, since=0):
        """Waits for a line of the log with all of these."""
        wait_for(lambda: any(all(part in line for part in parts)
                             for line in self.daemon.said[since:]), f"a line with {parts}")


class SecurityTest(SecuredTest):
    # Which role a method needs is security_methods_test's: here that each is asked for it.
    def test_strangers_may_nothing_and_a_higher_role_may_more(self):
        may = {}
        for role in (None, *ROLES):
            with self.daemon.channel(role and self.daemon.tokens[role]) as channel:
                answers = {method.name: call(channel, method) for method in METHODS}
            refused = [grpc.StatusCode.UNAUTHENTICATED]
            refused += [grpc.StatusCode.PERMISSION_DENIED] if role else []
            may[role] = {name for name, (code, _) in answers.items() if code not in refused}
            for name in answers.keys() - may[role]:
                self.assertIn(f"'token {role}' is {role}" if role else "", answers[name][1], name)
        self.assertEqual((may[None], may["admin"]), (set(), {method.name for method in METHODS}))
        self.assertLess(may["viewer"], may["editor"])
        self.assertLess(may["editor"], may["operator"])
        self.assertLessEqual({"StopForces", "GetDevice", "StreamPoses"}, may["viewer"])
        self.assertIn("UpdateSettings", may["editor"] - may["viewer"])
        self.assertIn("EnableForces", may["operator"] - may["editor"])

    def test_health_and_reflection_are_not_there(self):
        # They are gRPC's own, and ask nobody who calls.
        for method in ("/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                       "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"):
            for token in (None, self.daemon.tokens["admin"]):
                with self.daemon.channel(token) as channel, \
                        self.assertRaises(grpc.RpcError) as refused:
                    list(channel.stream_stream(method)(iter([b""]), timeout=PATIENCE_S))
                self.assertEqual(refused.exception.code(), grpc.StatusCode.UNIMPLEMENTED, method)

    def test_a_token_without_tls_is_refused(self):
        # A proxy in the middle, or a client of ours that forgot TLS: on the plain socket.
        token = self.daemon.tokens["admin"].read_text().strip()
        with self.daemon.local_channel() as channel:
            code, line = call(channel, METHODS[0], [("authorization", "Bearer " + token)])
        self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED)
        self.assertIn("TLS", line)
        self.assertNotIn(token, "".join(self.daemon.said))
        with grpc.insecure_channel(self.daemon.address) as channel:
            self.assertEqual(call(channel, METHODS[0])[0], grpc.StatusCode.UNAVAILABLE)

    def test_guessed_and_doubled_tokens_are_refused(self):
        good = self.daemon.tokens["admin"].read_text().strip()
        with self.daemon.channel() as channel:
            for values in (("",), ("Bearer",), ("Bearer ",), ("Basic " + good,),
                           ("bearer " + good,), (good,), ("Bearer " + good[:-1],),
                           ("Bearer " + good + "A",), ("Bearer " + "palpate_" * 9,),
                           ("Bearer palpate_" + "A" * 4000,), ("Bearer " + good,) * 2):
                code, _ = call(channel, METHODS[0], [("authorization", v) for v in values])
                self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED, values[0][:30])

    def test_the_command_line_reaches_it(self):
        ca = ["--server", self.daemon.address, "--tls-ca", str(self.daemon.authority.ca)]
        viewer = str(self.daemon.tokens["viewer"])

        def run(code, *arguments, **environment):
            done = subprocess.run([PALPATE, *arguments], capture_output=True, text=True,
                                  timeout=PATIENCE_S, env={**os.environ, **environment})
            self.assertEqual(done.returncode, code, done.stderr)
            return done.stderr

        run(0, "info", *ca, PALPATE_TOKEN_FILE=viewer)
        self.assertIn("editor", run(5, "set", "stiffness", "0.5", *ca, "--token-file", viewer))
        run(5, "info", *ca)
        # Others may read it: one line more, for an option and for the environment.
        os.chmod(viewer, 0o644)
        for warned in (run(0, "info", *ca, "--token-file", viewer),
                       run(0, "info", *ca, PALPATE_TOKEN_FILE=viewer)):
            self.assertRegex(warned, rf"\Apalpate: warning: .*{viewer}.*chmod 600.*\n")
            self.assertEqual(warned.count("palpate: "), 1)
        os.chmod(viewer, 0o600)
        self.assertEqual(run(0, "info", *ca, "--token-file", viewer), "")
        self.assertIn("TLS", run(3, "info", *ca[:2], "--token-file", viewer))

    def test_a_stop_has_a_name_and_an_address(self):
        with self.daemon.channel(self.daemon.tokens["viewer"]) as channel:
            code, _ = call(channel, STOP)
        self.assertEqual(code, grpc.StatusCode.OK)
        self.said("emergency stop, by token viewer at ip")
        with palpate.connect(self.daemon.socket) as conn:
            self.assertRegex(conn.device.info().forces_set_by, r"^token viewer at ip(v4|v6):")
            conn.device.enable()
            self.assertEqual(conn.device.info().forces_set_by, "local socket")

    def test_a_flood_of_stops_does_not_fill_the_log(self):
        token, stops = self.daemon.tokens["editor"], 60
        for _ in range(stops):
            # Each from a port of its own, so that no two lines are the same.
            with self.daemon.channel(token) as channel:
                code, _ = call(channel, STOP)
                self.assertEqual(code, grpc.StatusCode.OK)
        self.said("emergency stop, by token editor at ip")
        lines = sum("emergency stop, by token editor" in line for line in self.daemon.said)
        self.assertLess(lines, stops // 2)

    def test_dawdlers_and_oversize_messages_do_not_hinder_others(self):
        channel = self.enterContext(self.daemon.channel(self.daemon.tokens["editor"]))
        stream = PoseStreams(self).begin(channel)
        files = self.daemon.open_files()
        with contextlib.ExitStack() as stack:
            dawdlers = dawdle(stack, self.daemon.port)
            # A whole handshake, and half of one: the daemon's answer to it is not answered.
            context = self.daemon.tls()
            dawdlers.append(stack.enter_context(context.wrap_socket(
                socket.create_connection(("127.0.0.1", self.daemon.port)),
                server_hostname="localhost")))
            hello = ssl.MemoryBIO()
            with contextlib.suppress(ssl.SSLWantReadError):
                context.wrap_bio(ssl.MemoryBIO(), hello, server_hostname="localhost").do_handshake()
            dawdlers.append(stack.enter_context(
                socket.create_connection(("127.0.0.1", self.daemon.port))))
            dawdlers[-1].sendall(hello.read())
            stub = render_pb2_grpc.RenderServiceStub(channel)
            for _ in range(50):
                stub.GetSettings(render_pb2.GetSettingsRequest(), timeout=PATIENCE_S)
            huge = render_pb2.UpdateSettingsRequest()
            huge.update_mask.paths.append("x" * (5 << 20))
            with self.assertRaises(grpc.RpcError) as refused:
                stub.UpdateSettings(huge, timeout=PATIENCE_S)
            self.assertEqual(refused.exception.code(), grpc.StatusCode.RESOURCE_EXHAUSTED)
            stub.GetSettings(render_pb2.GetSettingsRequest(), timeout=PATIENCE_S)
            # The daemon ends them by itself.
            for dawdler in dawdlers:
                dawdler.settimeout(PATIENCE_S)
                with contextlib.suppress(ConnectionResetError):
                    while dawdler.recv(4096):
                        pass
        wait_for(lambda: self.daemon.open_files() <= files, f"{files} files")
        for _ in range(60):
            next(stream)

    def test_rotation(self):
        def served():
            with socket.create_connection(("127.0.0.1", self.daemon.port),
                                          timeout=PATIENCE_S) as plain, \
                    self.daemon.tls().wrap_socket(plain, server_hostname="localhost") as tls:
                return tls.getpeercert()["serialNumber"]

        first = served()
        # A pair that does not match: refused with a line, and the old one stays.
        certificate, key = self.daemon.authority.issue(
            "next", "DNS:localhost,IP:127.0.0.1", purpose="serverAuth")
        since = len(self.daemon.said)
        self.daemon.certificate.write_bytes(certificate.read_bytes())
        self.said(str(self.daemon.key), since=since)
        self.assertEqual(served(), first)
        self.daemon.key.write_bytes(key.read_bytes())
        wait_for(lambda: served() != first, "the new certificate")
        with self.daemon.channel(self.daemon.tokens["viewer"]) as channel:
            stop_forces(channel)


class LogTest(SecuredTest):
    """With a daemon of its own: of many refusals of one address some lines are left out."""

    def test_each_refusal_says_why_and_is_in_the_log_with_its_peer(self):
        lab = self.daemon.authority
        admin = self.daemon.tokens["admin"].read_text().strip()
        wrong = self.daemon.security / "wrong.token"
        wrong.write_text(admin[:-3] + "abc")
        other = Authority(self.daemon.security, "other")
        for credentials, who, why in (
                ({}, "a stranger", "neither a token nor a certificate"),
                ({"token": wrong}, "a stranger", "unknown"),
                ({"certificate": other.issue("fake", "DNS:viewer.lab.example")}, "a stranger",
                 "is refused"),
                ({"certificate": lab.issue("old", "DNS:viewer.lab.example", days=-1)},
                 "a stranger", "expired"),
                ({"certificate": lab.issue("viewer", "DNS:viewer.lab.example")},
                 "certificate viewer.lab.example", "operator"),
                ({"token": self.daemon.tokens["editor"]}, "token editor", "operator")):
            since = len(self.daemon.said)
            with self.subTest(who=who, why=why), self.daemon.channel(**credentials) as channel:
                code, line = call(channel, ENABLE)
                self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED if who == "a stranger"
                                 else grpc.StatusCode.PERMISSION_DENIED)
                self.assertIn(why, line)
                self.said(f"refused {who} at ipv4:127.0.0.1:", "DeviceService/EnableForces", why,
                          since=since)
        self.assertNotIn(admin[8:], "".join(self.daemon.said))


class LimitsTest(unittest.TestCase):
    def start(self, limits):
        return self.enterContext(SecuredDaemon(f"[limits]\n{limits}\n"))

    def test_a_flood_of_connections_keeps_nobody_out_for_long(self):
        daemon = self.start("connections = 100")
        viewer = daemon.tokens["viewer"]
        early = self.enterContext(daemon.channel(viewer))
        stop_forces(early)
        for _ in range(FLOOD):
            self.enterContext(socket.create_connection(("127.0.0.1", daemon.port)))
        # At the door, or soon after it: whichever the flood is faster than.
        wait_for(lambda: any("too many are" in line for line in daemon.said), "a line")
        # Each that is watched has a second file.
        wait_for(lambda: daemon.open_files() < 2 * STRANGERS + 100, "those beyond the bound to go")
        # Who was there stays; the stop on the workstation gets through.
        stop_forces(early)
        with daemon.local_channel() as local:
            stop_forces(local)

        def comes():
            with daemon.channel(viewer) as late, contextlib.suppress(grpc.RpcError):
                return stop_forces(late) is not None

        # The flood is still there, but never said a word.
        wait_for(comes, "a place for another client")

    # Rates and counts are security_limits_test's: here that they are those of the file.
    @contextlib.contextmanager
    def held_streams(self, limit, channel, count, **start):
        """So many streams begin and no more; another one, when they have ended."""
        streams = PoseStreams(self)
        held = [streams.begin(channel, **start) for _ in range(count)]
        with self.assertRaises(grpc.RpcError) as refused:
            streams.begin(channel, **start)
        self.assertEqual(refused.exception.code(), grpc.StatusCode.RESOURCE_EXHAUSTED)
        self.assertIn(limit, refused.exception.details())
        yield
        for stream in held:
            stream.cancel()

        def comes():
            with contextlib.suppress(grpc.RpcError):
                return streams.begin(channel, **start) is not None

        wait_for(comes, "room for a stream")

    def test_an_identity_has_so_many_streams_and_calls(self):
        daemon = self.start("pose_streams = 2\ncalls_per_s = 1")
        channel = self.enterContext(daemon.channel(daemon.tokens["viewer"]))
        with self.held_streams("limits.pose_streams", channel, 2):
            wait_for(lambda: call(channel, METHODS[0])[0] == grpc.StatusCode.RESOURCE_EXHAUSTED,
                     "a call that is too much")
            # The emergency stop is never too much.
            for _ in range(30):
                stop_forces(channel)

    def test_a_live_copy_waits_for_room(self):
        daemon = self.start("volume_streams = 1")
        with daemon.connect() as conn, conn.volume.follow() as held:
            self.assertEqual(held.values.shape, (48, 48, 48))
            with conn.volume.follow() as waiting:
                wait_for(lambda: waiting.lost is not None, "a refusal")
                held.close()
                self.assertEqual(waiting.values.shape, (48, 48, 48))

    def test_one_over_the_network_has_half_of_the_samples(self):
        daemon = self.start("pose_samples_per_s = 4000")
        channel = self.enterContext(daemon.channel(daemon.tokens["viewer"]))
        with self.held_streams("limits.pose_samples_per_s", channel, 2, rate_hz=1000,
                               max_unacknowledged=64), \
                daemon.connect() as conn, conn.poses(1000) as stream:
            next(stream)  # another client is served


if __name__ == "__main__":
    unittest.main()
