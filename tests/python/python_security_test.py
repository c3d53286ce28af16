"""Attacks on a palpated with TLS, over real sockets; and what those who may, may."""

import contextlib
import os
import pathlib
import resource
import socket
import ssl
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import warnings

import grpc
from google.protobuf import symbol_database

import palpate
from palpate.v1 import (device_pb2, device_pb2_grpc, pose_pb2, pose_pb2_grpc, recording_pb2,
                        registration_pb2, render_pb2, render_pb2_grpc, series_pb2, volume_pb2,
                        volume_pb2_grpc)
from authority import Authority
from excuse import busy_machine_may_explain
from secured import ROLES, SecuredDaemon, dawdle, wait_for
from support import PALPATE, PALPATED, PATIENCE_S

FILES = (device_pb2, pose_pb2, recording_pb2, registration_pb2, render_pb2, series_pb2, volume_pb2)
METHODS = [method for file in FILES for service in file.DESCRIPTOR.services_by_name.values()
           for method in service.methods]
# As many as this process may open, up to ten thousand.
# That may stay without a call.
STRANGERS = 64
FLOOD = min(10_000, resource.getrlimit(resource.RLIMIT_NOFILE)[0] - 1000)
def call(channel, method, metadata=None):
    """Calls any method with an empty request; the status code and its line."""
    service = method.containing_service.full_name
    classes = symbol_database.Default()
    request = classes.GetPrototype(method.input_type)
    response = classes.GetPrototype(method.output_type)
    kind = {(False, False): "unary_unary", (False, True): "unary_stream",
            (True, False): "stream_unary", (True, True): "stream_stream"}[
                (method.client_streaming, method.server_streaming)]
    stub = getattr(channel, kind)(f"/{service}/{method.name}",
                                  request_serializer=request.SerializeToString,
                                  response_deserializer=response.FromString)
    what = iter([request()]) if method.client_streaming else request()
    try:
        answer = stub(what, timeout=20.0, metadata=metadata)
        if method.server_streaming:
            next(iter(answer), None)
            answer.cancel()
        return grpc.StatusCode.OK, ""
    except grpc.RpcError as failed:
        return failed.code(), failed.details()


def stop_forces(channel):
    return device_pb2_grpc.DeviceServiceStub(channel).StopForces(device_pb2.StopForcesRequest(),
                                                                 timeout=20.0)


class SecurityTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls._folder = tempfile.TemporaryDirectory(prefix="palpate-security-")
        cls.daemon = SecuredDaemon(cls._folder.name)

    @classmethod
    def tearDownClass(cls):
        cls.daemon.end()
        cls._folder.cleanup()

    def said(self, *parts, since=0):
        """Waits for a line of the log with all of these."""
        wait_for(lambda: any(all(part in line for part in parts)
                             for line in self.daemon.said[since:]), f"a line with {parts}")

    def assert_stranger(self, channel, why):
        since = len(self.daemon.said)
        with channel:
            code, line = call(channel, METHODS[0])
        self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED, line)
        self.assertIn(why, line)
        return since

    def test_strangers_may_call_nothing(self):
        with self.daemon.channel() as channel:
            for method in METHODS:
                code, line = call(channel, method)
                self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED, method.full_name)

    def test_each_role_may_call_what_it_may(self):
        needs = {}
        for role in ROLES:
            with self.daemon.channel(self.daemon.tokens[role]) as channel:
                for method in METHODS:
                    code, line = call(channel, method)
                    self.assertNotEqual(code, grpc.StatusCode.UNAUTHENTICATED, method.full_name)
                    if code != grpc.StatusCode.PERMISSION_DENIED or "needs the role" not in line:
                        needs.setdefault(method.full_name, role)
                    else:
                        self.assertNotIn(method.full_name, needs, "a higher role may less")
                        self.assertIn(f"'token {role}' is {role}", line)
        self.assertEqual(set(needs), {method.full_name for method in METHODS})
        viewers = {name.rsplit(".")[-1] for name, role in needs.items() if role == "viewer"}
        self.assertEqual(viewers, {
            "StreamPoses", "StreamVolume", "GetVolume", "GetSettings", "GetRegistration",
            "GetSeries", "GetDevice", "ListDevices", "GetRecording", "StopForces"})
        for name in ("EnableForces", "LoadVolume", "UploadVolume", "SaveVolume", "StartRecording",
                     "CalibrateDevice", "Replay", "LoadSeries"):
            self.assertIn("operator", [role for full, role in needs.items()
                                       if full.endswith("." + name)], name)

    def test_certificates_are_judged_by_authority_name_and_time(self):
        lab = self.daemon.authority
        other = Authority(self._folder.name, "other")
        cases = [
            (other.issue("fake", "DNS:viewer.lab.example"), "its certificate is refused: "),
            (lab.issue("old", "DNS:viewer.lab.example", days=-1), "expired"),
            (lab.issue("unknown", "DNS:nobody.lab.example"), "nobody.lab.example) have no role"),
            (lab.issue("web", "DNS:viewer.lab.example", purpose="serverAuth"), "purpose"),
        ]
        for certificate, why in cases:
            since = self.assert_stranger(self.daemon.channel(certificate=certificate), why)
            del since
        good = lab.issue("viewer", "DNS:viewer.lab.example")
        with self.daemon.channel(certificate=good) as channel:
            self.assertEqual(call(channel, METHODS[0])[0], grpc.StatusCode.OK)
            code, line = call(channel, device_pb2.DESCRIPTOR.services_by_name["DeviceService"]
                              .methods_by_name["EnableForces"])
            self.assertEqual(code, grpc.StatusCode.PERMISSION_DENIED)
            self.assertIn("needs the role operator, and 'certificate viewer.lab.example' is viewer",
                          line)

    def test_health_and_reflection_are_not_there(self):
        # They are gRPC's own, and ask nobody who calls.
        for method in ("/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                       "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"):
            for token in (None, self.daemon.tokens["admin"]):
                with self.daemon.channel(token) as channel, \
                        self.assertRaises(grpc.RpcError) as refused:
                    list(channel.stream_stream(method)(iter([b""]), timeout=20.0))
                self.assertEqual(refused.exception.code(), grpc.StatusCode.UNIMPLEMENTED, method)

    def test_headers_of_grpcs_own_do_not_end_it(self):
        # gRPC 1.51 aborts where it writes the first of them for a metadata processor.
        ticks = self.daemon.ticks()
        for name in (b"grpclb_client_stats", b"lb-token", b"lb-cost-bin", b"grpc-trace-bin",
                     b"grpc-tags-bin", b"grpc-server-stats-bin", b"grpc-previous-rpc-attempts",
                     b"grpc-retry-pushback-ms", b"grpc-status", b"grpc-message", b"host"):
            for value in (b"x", b"", b"1", b"\xff" * 8):
                self.daemon.send_call([(name, value)])
        self.assertGreater(self.daemon.ticks(), ticks)

    def test_a_revoked_token_ends_its_streams_and_cannot_be_replayed(self):
        token = self.daemon.add_token("leaver", "editor")
        channel = self.daemon.channel(token)
        self.addCleanup(channel.close)
        wait_for(lambda: call(channel, METHODS[0])[0] == grpc.StatusCode.OK, "the new token")
        start = pose_pb2.StreamPosesRequest()
        start.start.rate_hz = 60
        done = threading.Event()

        def requests():
            yield start
            done.wait()

        self.addCleanup(done.set)
        stream = pose_pb2_grpc.PoseServiceStub(channel).StreamPoses(requests(), timeout=60.0)
        next(stream)
        self.daemon.revoke_token("leaver")
        began = time.monotonic()
        with self.assertRaises(grpc.RpcError) as ended:
            for _ in stream:
                pass
        self.assertEqual(ended.exception.code(), grpc.StatusCode.CANCELLED)
        self.assertLess(time.monotonic() - began, 30.0)
        code, line = call(channel, METHODS[0])
        self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED)
        self.assertIn("revoked", line)
        self.said("ended /palpate.v1.PoseService/StreamPoses of token leaver")

    def test_a_token_without_tls_is_refused(self):
        # A proxy in the middle, or a client of ours that forgot TLS: on the plain socket.
        token = self.daemon.tokens["admin"].read_text().strip()
        with grpc.insecure_channel("unix:" + self.daemon.socket) as channel:
            code, line = call(channel, METHODS[0], [("authorization", "Bearer " + token)])
        self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED)
        self.assertIn("without TLS", line)
        self.assertNotIn(token, "".join(self.daemon.said))
        with self.assertRaises(palpate.InvalidArgument):
            palpate.connect(self.daemon.address, token_file=str(self.daemon.tokens["admin"]))
        with grpc.insecure_channel(self.daemon.address) as channel:
            self.assertEqual(call(channel, METHODS[0])[0], grpc.StatusCode.UNAVAILABLE)

    def test_guessed_and_doubled_tokens_are_refused(self):
        good = self.daemon.tokens["admin"].read_text().strip()
        with self.daemon.channel() as channel:
            for value in ("", "Bearer", "Bearer ", "Basic " + good, "bearer " + good, good,
                          "Bearer " + good[:-1], "Bearer " + good + "A", "Bearer " + "palpate_" * 9,
                          "Bearer palpate_" + "A" * 4000):
                code, _ = call(channel, METHODS[0], [("authorization", value)])
                self.assertEqual(code, grpc.StatusCode.UNAUTHENTICATED, value[:30])
            doubled = [("authorization", "Bearer " + good)] * 2
            self.assertEqual(call(channel, METHODS[0], doubled)[0],
                             grpc.StatusCode.UNAUTHENTICATED)

    def test_clients_of_ours_reach_it(self):
        ca = str(self.daemon.authority.ca)
        viewer = str(self.daemon.tokens["viewer"])
        operator = self.daemon.authority.issue("operator", "URI:spiffe://lab/operator")
        os.chmod(viewer, 0o644)
        with self.assertWarnsRegex(UserWarning, "may be read by every account") as warned:
            palpate.connect(self.daemon.address, tls_ca=ca, token_file=viewer).close()
        self.assertEqual(warned.filename, __file__)
        os.chmod(viewer, 0o640)
        with warnings.catch_warnings(action="error"), \
                palpate.connect(self.daemon.address, tls_ca=ca, token_file=viewer) as conn:
            self.assertGreater(conn.device.info().ticks, 0)
            with self.assertRaisesRegex(palpate.PermissionDenied, "needs the role editor"):
                conn.settings.stiffness_n_per_mm = 0.4
        with palpate.connect(self.daemon.address, tls_ca=ca, tls_cert=str(operator[0]),
                             tls_key=str(operator[1])) as conn:
            conn.settings.stiffness_n_per_mm = 0.4
        with self.assertRaises(palpate.PermissionDenied):
            palpate.connect(self.daemon.address, tls_ca=ca)
        with self.assertRaisesRegex(palpate.Unavailable, "that answers without TLS"):
            palpate.connect(self.daemon.address)
        with self.assertRaisesRegex(palpate.InvalidArgument, "holds no PRIVATE KEY in PEM"):
            palpate.connect(self.daemon.address, tls_ca=ca, tls_cert=str(operator[0]),
                            tls_key=str(operator[0]))
        with self.assertRaisesRegex(palpate.Unavailable, "proves itself"):
            palpate.connect(self.daemon.address,
                            tls_ca=str(Authority(self._folder.name, "wrong").ca))

    def test_the_command_line_reaches_it(self):
        ca = ["--server", self.daemon.address, "--tls-ca", str(self.daemon.authority.ca)]

        def run(*arguments, **environment):
            return subprocess.run([PALPATE, *arguments], capture_output=True, text=True,
                                  env={**os.environ, **environment})

        viewer = str(self.daemon.tokens["viewer"])
        self.assertEqual(run("info", *ca, "--token-file", viewer).returncode, 0)
        self.assertEqual(run("info", *ca, PALPATE_TOKEN_FILE=viewer).returncode, 0)
        refused = run("set", "stiffness", "0.5", *ca, "--token-file", viewer)
        self.assertEqual(refused.returncode, 5, refused.stderr)
        self.assertIn("needs the role editor", refused.stderr)
        self.assertEqual(run("info", *ca).returncode, 5)
        # Others may read it: a line more, and only then.
        os.chmod(viewer, 0o644)
        warned = run("info", *ca, "--token-file", viewer)
        self.assertEqual(warned.returncode, 0)
        self.assertRegex(warned.stderr, r"\Apalpate: warning: the token file .*'chmod 600'.*\n\Z")
        os.chmod(viewer, 0o600)
        self.assertEqual(run("info", *ca, "--token-file", viewer).stderr, "")
        plain = run("info", "--server", self.daemon.address, "--token-file", viewer)
        self.assertEqual(plain.returncode, 3)
        self.assertIn("over TLS only", plain.stderr)

    def test_dawdlers_and_oversize_messages_do_not_hinder_others(self):
        with contextlib.ExitStack() as stack:
            began = time.monotonic()
            dawdlers = dawdle(stack, self.daemon.port)
            context = ssl.create_default_context(cafile=str(self.daemon.authority.ca))
            context.set_alpn_protocols(["h2"])
            silent = stack.enter_context(context.wrap_socket(
                socket.create_connection(("127.0.0.1", self.daemon.port)),
                server_hostname="localhost"))
            channel = stack.enter_context(self.daemon.channel(self.daemon.tokens["editor"]))
            stub = render_pb2_grpc.RenderServiceStub(channel)
            for _ in range(50):
                stub.GetSettings(render_pb2.GetSettingsRequest(), timeout=20.0)
            huge = render_pb2.UpdateSettingsRequest()
            huge.update_mask.paths.append("x" * (5 << 20))
            with self.assertRaises(grpc.RpcError) as refused:
                stub.UpdateSettings(huge, timeout=20.0)
            self.assertEqual(refused.exception.code(), grpc.StatusCode.RESOURCE_EXHAUSTED)
            stub.GetSettings(render_pb2.GetSettingsRequest(), timeout=20.0)
            # The daemon ends them by itself, after 10 s.
            seconds = []
            for dawdler in [*dawdlers, silent]:
                dawdler.settimeout(60.0)
                with contextlib.suppress(ConnectionResetError):
                    while dawdler.recv(4096):
                        pass
                seconds.append(time.monotonic() - began)
            print(f"dawdlers were ended after {statistics.median(seconds):.1f} s (median)",
                  file=sys.stderr)
            self.assertLess(statistics.median(seconds), 20.0)

    def test_rotation(self):
        def served():
            context = ssl.create_default_context(cafile=str(self.daemon.authority.ca))
            context.set_alpn_protocols(["h2"])
            with socket.create_connection(("127.0.0.1", self.daemon.port), timeout=20.0) as plain, \
                    context.wrap_socket(plain, server_hostname="localhost") as tls:
                return tls.getpeercert()["serialNumber"]

        first = served()
        # A pair that does not match: refused with a line, and the old one stays.
        certificate, key = self.daemon.authority.issue(
            "next", "DNS:localhost,IP:127.0.0.1", purpose="serverAuth")
        since = len(self.daemon.said)
        self.daemon.certificate.write_bytes(certificate.read_bytes())
        self.said("the certificate stays as it was", "is not the key of", since=since)
        self.assertEqual(served(), first)
        self.daemon.key.write_bytes(key.read_bytes())
        wait_for(lambda: served() != first, "the new certificate")
        with self.daemon.channel(self.daemon.tokens["viewer"]) as channel:
            stop_forces(channel)


class LogTest(unittest.TestCase):
    def test_every_attack_is_in_the_log_with_its_peer(self):
        with tempfile.TemporaryDirectory(prefix="palpate-security-") as folder:
            daemon = SecuredDaemon(folder)
            self.addCleanup(daemon.end)
            other = Authority(folder, "other")
            lab = daemon.authority
            admin = daemon.tokens["admin"].read_text().strip()
            wrong = pathlib.Path(folder, "wrong.token")
            wrong.write_text(admin[:-3] + "abc")
            set_forces = device_pb2.DESCRIPTOR.services_by_name["DeviceService"].methods_by_name[
                "EnableForces"]
            for credentials, why in (
                    ({}, "neither a token nor a certificate came"),
                    ({"certificate": other.issue("fake", "DNS:viewer.lab.example")}, "is refused"),
                    ({"certificate": lab.issue("old", "DNS:viewer.lab.example", days=-1)},
                     "expired"),
                    ({"certificate": lab.issue("x", "DNS:x.example")}, "(x.example) have no role"),
                    ({"token": wrong}, "its token is unknown"),
                    ({"token": daemon.tokens["editor"]},
                     "needs the role operator, and 'token editor' is editor")):
                with daemon.channel(**credentials) as channel:
                    self.assertNotEqual(call(channel, set_forces)[0], grpc.StatusCode.OK)
                who = "token editor" if why.startswith("needs") else "a stranger"
                parts = (f"refused {who} at ipv4:127.0.0.1:",
                         "to call /palpate.v1.DeviceService/EnableForces", why)
                wait_for(lambda: any(all(part in line for part in parts) for line in daemon.said),
                         f"a line with {parts}")
            self.assertNotIn(admin[8:], "".join(daemon.said))


class LimitsTest(unittest.TestCase):
    def test_a_flood_of_connections_keeps_nobody_out_for_long(self):
        with tempfile.TemporaryDirectory(prefix="palpate-security-") as folder:
            daemon = SecuredDaemon(folder, "[limits]\nconnections = 100\n")
            self.addCleanup(daemon.end)
            viewer = daemon.tokens["viewer"]
            with daemon.channel(viewer) as early, contextlib.ExitStack() as stack:
                stop_forces(early)
                flood = [stack.enter_context(socket.create_connection(("127.0.0.1", daemon.port)))
                         for _ in range(FLOOD)]
                # At the door, or soon after it: whichever the flood is faster than.
                wait_for(lambda: any("too many are open" in line
                                     or "too many are connected without a call" in line
                                     for line in daemon.said), "a line")

                def files():
                    return len(os.listdir(f"/proc/{daemon.process.pid}/fd"))

                # Each that is watched has a second one.
                with busy_machine_may_explain():
                    self.assertLess(files(), 2 * (100 + 256))
                wait_for(lambda: files() < 2 * STRANGERS + 100, "those beyond the bound to go")
                print(f"{files()} files open", file=sys.stderr)
                # Who was there stays; the stop on the workstation gets through.
                stop_forces(early)
                with grpc.insecure_channel("unix:" + daemon.socket) as local:
                    stop_forces(local)

                def comes():
                    with daemon.channel(viewer) as late:
                        try:
                            return stop_forces(late) is not None
                        except grpc.RpcError:
                            return False

                # The flood is still there, but never said a word.
                self.assertEqual(len(flood), FLOOD)
                wait_for(comes, "a place for another client", 120.0)

    def test_an_identity_has_so_many_streams_and_calls(self):
        with tempfile.TemporaryDirectory(prefix="palpate-security-") as folder:
            daemon = SecuredDaemon(folder, "[limits]\npose_streams = 2\ncalls_per_s = 20\n")
            self.addCleanup(daemon.end)
            with daemon.channel(daemon.tokens["viewer"]) as channel:
                start = pose_pb2.StreamPosesRequest()
                start.start.rate_hz = 60
                done = threading.Event()

                def requests():
                    yield start
                    done.wait()

                stub = pose_pb2_grpc.PoseServiceStub(channel)
                streams = [stub.StreamPoses(requests()) for _ in range(2)]
                for stream in streams:
                    next(stream)
                with self.assertRaises(grpc.RpcError) as refused:
                    next(stub.StreamPoses(requests()))
                self.assertEqual(refused.exception.code(), grpc.StatusCode.RESOURCE_EXHAUSTED)
                self.assertIn("limits.pose_streams", refused.exception.details())
                codes = [call(channel, METHODS[0])[0] for _ in range(200)]
                self.assertIn(grpc.StatusCode.RESOURCE_EXHAUSTED, codes)
                # The emergency stop is never too much.
                for _ in range(30):
                    stop_forces(channel)
                # Ended ones make room, and the next may come.
                for stream in streams:
                    stream.cancel()

                def comes():
                    try:
                        return next(stub.StreamPoses(requests())) is not None
                    except grpc.RpcError:
                        return False

                wait_for(comes, "room for a stream")
                done.set()


class StartTest(unittest.TestCase):
    def refusal(self, text, *more):
        with tempfile.TemporaryDirectory(prefix="palpate-security-") as folder:
            config = pathlib.Path(folder, "palpated.toml")
            config.write_text(text.replace("FOLDER", folder))
            ended = subprocess.run(
                [PALPATED, "--config", str(config), "--volume", "builtin:sphere:16", "--socket",
                 folder + "/s.sock", "--state-folder", "", *more],
                capture_output=True, text=True, timeout=PATIENCE_S)
            self.assertNotEqual(ended.returncode, 0)
            return ended.stderr

    def test_other_addresses_want_tls_and_known_clients(self):
        self.assertIn("without TLS only loopback", self.refusal("", "--listen", "0.0.0.0:7400"))
        with tempfile.TemporaryDirectory(prefix="palpate-security-") as folder:
            certificate, key = Authority(folder, "lab").issue("server", "DNS:localhost",
                                                              purpose="serverAuth")
            text = f'[tls]\ncertificate = "{certificate}"\nkey = "{key}"\n'
            self.assertIn("a way to know clients", self.refusal(text, "--listen", "0.0.0.0:7400"))
            tokens = pathlib.Path(folder, "tokens.toml")
            tokens.write_text("")
            tokens.chmod(0o666)
            text += f'tokens = "{tokens}"\n'
            self.assertIn("may be written by others", self.refusal(text))
            tokens.chmod(0o600)
            key.chmod(0o644)
            self.assertIn("may be read", self.refusal(text))


if __name__ == "__main__":
    unittest.main()
