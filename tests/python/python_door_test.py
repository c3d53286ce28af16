"""palpate-door: nginx in front of palpated's sockets."""

import json
import re
import signal
import subprocess
import time
import unittest

import grpc

import palpate
from authority import Authority
from behind_door import DaemonBehindDoor
from palpate.v1 import device_pb2
from python_security_test import STOP, PoseStreams, call
from secured import stop_forces, wait_for
from palpate._address import role_socket_path
from support import METHODS, PATIENCE_S

UNAUTHENTICATED = grpc.StatusCode.UNAUTHENTICATED
GET = next(method for method in METHODS if method.name == "GetDevice")


class DoorTest(unittest.TestCase):
    def start(self, *arguments, **keywords):
        return self.enterContext(DaemonBehindDoor(*arguments, **keywords))

    def code(self, daemon, **credentials):
        with daemon.channel(**credentials) as channel:
            return call(channel, GET)

    def test_revoked_streams_end_and_others_go_on(self):
        daemon = self.start()
        bea = daemon.add_token("bea", "viewer")
        streams = {name: PoseStreams(self).begin(self.enterContext(daemon.channel(token)))
                   for name, token in (("bea", bea), ("viewer", daemon.tokens["viewer"]))}
        channel = self.enterContext(daemon.channel(bea))
        self.assertEqual(call(channel, GET)[0], grpc.StatusCode.OK)
        with palpate.connect(daemon.socket) as conn:
            self.assertEqual(conn.end_caller("token nobody"), 0)
        daemon.nginx.send_signal(signal.SIGHUP)  # ends nobody's calls
        daemon.revoke_token("bea")
        # A connection that was there before, too.
        code, line = call(channel, GET)
        self.assertEqual(code, UNAUTHENTICATED)
        self.assertIn("revoked", line)
        with self.assertRaises(grpc.RpcError):
            for _ in range(10_000):
                next(streams["bea"])
        for _ in range(60):
            next(streams["viewer"])
        self.assertNotIn("bea", daemon.run_door("list"))
        self.assertTrue(any("PoseService/StreamPoses of token bea" in line and "ended" in line
                            for line in daemon.said), daemon.said)

    def test_who_may_not_come(self):
        daemon = self.start()
        lab, name = daemon.authority, "DNS:viewer.lab.example"
        ok = lab.issue("viewer", name)
        self.assertEqual(self.code(daemon, certificate=ok)[0], grpc.StatusCode.OK)
        expired = daemon.add_token("old", "viewer")
        for file in (daemon.door / "callers").iterdir():
            caller = json.loads(file.read_text())
            if caller["name"] == "old":
                file.write_text(json.dumps({**caller, "expires_s": int(time.time()) - 1}))
        good = daemon.tokens["admin"].read_text().strip()
        with daemon.channel() as channel:
            for values in (("",), ("Bearer",), ("Basic " + good,), (good,), ("Bearer " + good[:-1],),
                           ("Bearer palpate_" + "A" * 4000,), ("Bearer " + good,) * 2):
                code, _ = call(channel, GET, [("authorization", value) for value in values])
                self.assertEqual(code, UNAUTHENTICATED, values[0][:30])
        wrong = daemon.security / "wrong.token"
        wrong.write_text("palpate_" + "A" * 43)
        other = Authority(daemon.security, "other")
        for credentials, why in (
                ({}, "neither a token nor a certificate"), ({"token": wrong}, "unknown"),
                ({"token": expired}, "expired"),
                ({"certificate": lab.issue("old", name, days=-1)}, "expired"),
                ({"certificate": lab.issue("no", "DNS:nobody.lab.example")}, "no name"),
                ({"certificate": other.issue("fake", name)}, "is refused")):
            with self.subTest(why):
                since = len(daemon.said)
                code, line = self.code(daemon, **credentials)
                self.assertEqual(code, UNAUTHENTICATED)
                self.assertIn(why, line)
                wait_for(lambda: any("refused a stranger at ipv4:127.0.0.1:" in said and why in said
                                     for said in daemon.said[since:]), "a line")

    def test_a_list_of_revoked_certificates(self):
        daemon = self.start()
        gone = daemon.authority.issue("gone", "DNS:viewer.lab.example")
        kept = daemon.authority.issue("kept", "DNS:viewer.lab.example")
        crl = daemon.authority.revoke(gone[0])
        config = daemon.door / "door.toml"
        config.write_text(config.read_text() + f'crl = "{crl}"\n')
        daemon.close_door()
        daemon.open_door(f"127.0.0.1:{daemon.port}")
        self.assertEqual(self.code(daemon, certificate=gone)[0], UNAUTHENTICATED)
        self.assertEqual(self.code(daemon, certificate=kept)[0], grpc.StatusCode.OK)

    def test_a_stop_goes_by_its_own_way_and_has_a_name(self):
        daemon = self.start()
        with daemon.channel(daemon.tokens["viewer"]) as channel:
            answer = stop_forces(channel)
            self.assertEqual(answer.forces.state, device_pb2.FORCE_STATE_STOPPED)
            self.assertGreater(answer.applied_tick, 0)
            self.assertGreater(answer.forces.limit_n, 0)
            self.assertEqual(call(channel, STOP, [("palpate-caller", "token admin")])[0],
                             grpc.StatusCode.OK)
        wait_for(lambda: any(re.search(r"emergency stop, by token viewer at ipv4:127.0.0.1:\d+", line)
                             for line in daemon.said), "a line")
        with palpate.connect(daemon.socket) as conn:
            self.assertRegex(conn.device.info().forces_set_by, r"^token viewer at ipv4:127.0.0.1:\d+$")
        self.assertFalse([line for line in daemon.said if "[error]" in line])
        # Whoever may not come may not stop.
        with daemon.channel() as channel:
            self.assertEqual(call(channel, STOP)[0], UNAUTHENTICATED)

    def test_without_palpated(self):
        daemon = self.start()
        daemon.end()
        with daemon.channel(daemon.tokens["admin"]) as channel:
            for method in (GET, STOP):
                self.assertEqual(call(channel, method)[0], grpc.StatusCode.UNAVAILABLE)
        daemon.start()
        wait_for(lambda: self.code(daemon, token=daemon.tokens["admin"])[0] ==
                 grpc.StatusCode.OK, "palpated again")

    def test_a_role_may_through_the_door_what_it_may_by_its_socket(self):
        daemon = self.start()
        for role, token in daemon.tokens.items():
            with daemon.channel(token) as far, \
                    grpc.insecure_channel("unix:" + role_socket_path(daemon.socket, role)) as near:
                for method in METHODS:
                    codes = [call(channel, method)[0] for channel in (far, near)]
                    denied = [code == grpc.StatusCode.PERMISSION_DENIED for code in codes]
                    self.assertEqual(*denied, (role, method.name))
                    self.assertNotIn(UNAUTHENTICATED, codes)
            with daemon.channel(token) as channel, self.assertRaises(grpc.RpcError) as refused:
                channel.unary_unary("/grpc.health.v1.Health/Check")(b"", timeout=PATIENCE_S)
            self.assertEqual(refused.exception.code(), grpc.StatusCode.UNIMPLEMENTED)

    def test_a_download_is_equal(self):
        daemon = self.start(volume="builtin:sphere:128")
        with daemon.connect() as near, palpate.connect(
                daemon.address, tls_ca=str(daemon.authority.ca),
                token_file=str(daemon.tokens["viewer"])) as far:
            self.assertTrue((near.volume.download().values == far.volume.download().values).all())

    def test_what_palpated_kept_is_taken_over(self):
        daemon = self.start()
        folder = daemon.security / "before"
        folder.mkdir()
        token, salt = "palpate_" + "B" * 43, "0123456789abcdef" * 2
        hashed = subprocess.run(["sha256sum"], input=salt + token, capture_output=True, text=True,
                                check=True).stdout.split()[0]
        (folder / "tokens.toml").write_text(
            f'[[token]]\nname = "cleo"\nrole = "editor"\nsalt = "{salt}"\nsha256 = "{hashed}"\n'
            'expires = 2100-01-31T12:00:00Z\n')
        (folder / "palpated.toml").write_text(
            f'[tls]\ntokens = "{folder}/tokens.toml"\ncertificate = "/c.pem"\nkey = "/c.key"\n'
            '[[tls.client]]\nsan = "spiffe://lab/late"\nrole = "operator"\n')
        daemon.run_door("import", folder / "palpated.toml")
        (folder / "cleo.token").write_text(token)
        self.assertEqual(self.code(daemon, token=folder / "cleo.token")[0], grpc.StatusCode.OK)
        late = daemon.authority.issue("late", "URI:spiffe://lab/late")
        self.assertEqual(self.code(daemon, certificate=late)[0], grpc.StatusCode.OK)
        self.assertRegex(daemon.run_door("list"), r"cleo +editor +token +until 2100-01-31")
        # What the door had already stays.
        self.assertIn(str(daemon.certificate), (daemon.door / "door.toml").read_text())

    def test_bad_requests_change_nothing(self):
        daemon = self.start()
        before = daemon.run_door("list")
        for bad in (["add", "viewer", "--role", "viewer"], ["add", "a b", "--role", "viewer"],
                    ["revoke", "nobody"], ["run", "--listen", "localhost:7400"],
                    ["import", "/nothing.toml"]):
            with self.assertRaises(subprocess.CalledProcessError) as refused:
                daemon.run_door(*bad)
            self.assertRegex(refused.exception.stderr, r"\Apalpate-door: .*\n\Z", bad)
        self.assertEqual(daemon.run_door("list"), before)


if __name__ == "__main__":
    unittest.main()
