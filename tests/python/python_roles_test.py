"""The socket is the permission: a role has a socket, and a door says who calls."""

import contextlib
import grp
import os
import pathlib
import re
import signal
import socket
import stat
import subprocess
import threading
import time
import unittest

import grpc

import palpate
from palpate._address import beside, role_socket_path
from palpate._stop_socket import stop_by_socket, stop_socket_path
from palpate.v1 import device_pb2, facts_pb2, facts_pb2_grpc, render_pb2
from python_security_test import ENABLE, STOP, PoseStreams, SecuredTest, call
from secured import ROLES, SecuredDaemon, wait_for
from support import METHODS, PALPATE, PALPATED, PATIENCE_S, Daemon
from wire import DATA, END_STREAM, GET_DEVICE, Deaf, Unreading, frame

OWN_GROUP = grp.getgrgid(os.getegid()).gr_name
DOOR = f'[server]\ndoor_group = "{OWN_GROUP}"\nloopback_role = "viewer"\n'
ADA = [("palpate-caller", "token ada"), ("palpate-address", "192.0.2.7")]
ENABLE_PATH = b"/palpate.v1.DeviceService/EnableForces"
HEALTH, UNIMPLEMENTED = "/grpc.health.v1.Health/Check", grpc.StatusCode.UNIMPLEMENTED
REFUSED = (grpc.StatusCode.UNAUTHENTICATED, grpc.StatusCode.PERMISSION_DENIED)
GET = device_pb2.DESCRIPTOR.services_by_name["DeviceService"].methods_by_name["GetDevice"]
SET = render_pb2.DESCRIPTOR.services_by_name["RenderService"].methods_by_name["UpdateSettings"]


def socket_of(daemon, role, door=False):
    return (beside(daemon.socket, f"door-{role}") if door else
            role_socket_path(daemon.socket, role))


def channel_of(daemon, role, door=False):
    return grpc.insecure_channel("unix:" + socket_of(daemon, role, door))


def held(requests):
    """A client that says no more and does not end."""
    yield from requests
    threading.Event().wait(PATIENCE_S)


def code_of(channel, path):
    try:
        channel.unary_unary(path)(b"", timeout=PATIENCE_S)
        return grpc.StatusCode.OK
    except grpc.RpcError as refused:
        return refused.code()


class Doors(SecuredTest):
    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(SecuredDaemon(DOOR))

    # What a token of each role may is python_security_test's and security_methods_test's.
    def test_a_socket_may_what_a_token_of_its_role_may(self):
        def kinds(channel, metadata=None):
            answers = {method.full_name: call(channel, method, metadata) for method in METHODS}
            return {name: code if code in REFUSED else None
                    for name, (code, _) in answers.items()}

        for role in ROLES:
            with self.daemon.channel(self.daemon.tokens[role]) as channel:
                by_token = kinds(channel)
            with channel_of(self.daemon, role) as channel:
                self.assertEqual(kinds(channel), by_token, role)
            with channel_of(self.daemon, role, door=True) as channel:
                self.assertEqual(kinds(channel, ADA), by_token, f"door, {role}")
                # As a stranger over TLS.
                self.assertEqual(set(kinds(channel).values()), {grpc.StatusCode.UNAUTHENTICATED})

    def test_a_door_says_who_calls(self):
        with channel_of(self.daemon, "operator", door=True) as channel, \
                self.daemon.connect() as conn:
            stream = PoseStreams(self).begin(channel, metadata=ADA)
            self.assertIn(("token ada", "operator", "192.0.2.7", True),
                          [(one.identity, str(one.role), one.peer, one.watches)
                           for one in conn.activity().callers])
            next(stream)
            self.assertEqual(call(channel, STOP, ADA)[0], grpc.StatusCode.OK)
            self.said("emergency stop, by token ada at 192.0.2.7")
            self.assertEqual(conn.device.info().forces_set_by, "token ada at 192.0.2.7")
            self.assertEqual(call(channel, ENABLE, ADA[:1])[0], grpc.StatusCode.OK)
            self.assertEqual(conn.device.info().forces_set_by, "token ada")

    def test_nobody_else_is_believed(self):
        for metadata in (ADA, ADA[:1], ADA[1:], [ADA[0], ADA[0]], [("palpate-caller", "")],
                         [("palpate-caller", "a" * 129)]):
            for role in ROLES:
                with channel_of(self.daemon, role) as channel:
                    self.assertEqual(call(channel, STOP, metadata)[0], REFUSED[0], metadata)
            with self.daemon.channel(self.daemon.tokens["admin"]) as channel:
                self.assertEqual(call(channel, STOP, metadata)[0], REFUSED[0], metadata)
        token = ("authorization", "Bearer " + self.daemon.tokens["admin"].read_text().strip())
        with channel_of(self.daemon, "admin", door=True) as channel:
            for metadata in ([*ADA, token], [*ADA, ADA[0]], [("palpate-caller", "")],
                             [("palpate-caller", "a" * 129)], ADA[1:],
                             # Names of those who have none, and what looks like them.
                             *([("palpate-caller", name)] for name in
                               ("local socket", "viewer socket", "loopback", " a", "a ", " "))):
                code, _ = call(channel, STOP, metadata)
                self.assertEqual(code, REFUSED[0], metadata)

    def test_methods_that_do_not_exist(self):
        for role in ROLES:
            for door in (False, True):
                for method in ("/palpate.v1.DeviceService/Nothing", HEALTH):
                    with channel_of(self.daemon, role, door) as channel:
                        self.assertEqual(code_of(channel, method), UNIMPLEMENTED)


class Sockets(unittest.TestCase):
    def may_set(self, daemon, role):
        with channel_of(daemon, role) as channel:
            code, _ = call(channel, SET)
            return code not in REFUSED

    def owners(self, daemon, *paths):
        found = [os.stat(path) for path in paths]
        self.assertEqual({stat.S_IMODE(one.st_mode) for one in found}, {0o660})
        return [one.st_gid for one in found]

    def test_without_a_group_none_is_above_the_usual_one(self):
        daemon = self.enterContext(Daemon(config={"server": ['socket_role = "editor"']}))
        own = os.stat(daemon.socket).st_gid
        self.assertEqual(self.owners(daemon, *(socket_of(daemon, role) for role in ROLES)),
                         4 * [own])
        self.assertEqual([self.may_set(daemon, role) for role in ROLES],
                         [False, True, True, True])
        with channel_of(daemon, "operator") as channel:
            self.assertEqual(call(channel, ENABLE)[0], REFUSED[1])
            stream = PoseStreams(self).begin(channel)
            start = facts_pb2.FollowRequest(start=facts_pb2.FollowStart())
            followed = facts_pb2_grpc.FactsServiceStub(channel).Follow(held([start]))
            next(followed)
            # Lowered while it runs.
            config = daemon.folder / "palpated.toml"
            config.write_text(config.read_text().replace('"editor"', '"viewer"'))
            daemon.process.send_signal(signal.SIGHUP)
            wait_for(lambda: not self.may_set(daemon, "operator"), "the lower role")
            next(stream)
            # Who follows facts was told its role.
            with self.assertRaises(grpc.RpcError):
                list(followed)

    def test_a_group_of_its_own_is_the_permission(self):
        groups = grp.getgrall() if os.geteuid() == 0 else map(grp.getgrgid, os.getgroups())
        group = next((one for one in groups if one.gr_gid != os.getegid()), None)
        if group is None:
            self.skipTest("this user is in one group")
        daemon = self.enterContext(Daemon(config={
            "server": ['socket_role = "viewer"', f'operator_group = "{group.gr_name}"']}))
        paths = [daemon.socket, *(socket_of(daemon, role) for role in ("viewer", "operator"))]
        for found in (paths, [stop_socket_path(path) for path in paths]):
            self.assertEqual(self.owners(daemon, *found),
                             [os.getegid(), os.getegid(), group.gr_gid])
        self.assertNotEqual(stop_by_socket(stop_socket_path(paths[2])), None)
        self.assertEqual([self.may_set(daemon, role) for role in ROLES],
                         [False, False, True, False])

    def test_each_has_a_socket_until_the_end(self):
        daemon = self.enterContext(Daemon())
        sockets = {path.name for path in daemon.folder.glob("*.sock")}
        self.assertEqual(sockets, {f"palpated{part}.sock" for part in (
            "", "-operator", "-editor", "-viewer", "-stop",
            "-door-admin", "-door-operator", "-door-editor", "-door-viewer", "-door-stop")})
        # Without a group for doors.
        self.assertEqual({stat.S_IMODE(path.stat().st_mode) for path in daemon.folder.glob("*door*")},
                         {0o600})
        with channel_of(daemon, "operator") as operator, channel_of(daemon, "viewer") as viewer:
            self.assertEqual(code_of(operator, HEALTH), grpc.StatusCode.OK)
            self.assertEqual(code_of(viewer, HEALTH), UNIMPLEMENTED)  # no limit holds for it
        daemon.end(signal.SIGKILL)
        # As of one that had a group for operators.
        left = beside(socket_of(daemon, "operator"), "stop")
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(left)
        daemon.start()
        self.assertFalse(os.path.exists(left))
        self.assertTrue(self.may_set(daemon, "operator"))
        daemon.end()
        self.assertEqual([*daemon.folder.glob("*.sock")], [])

    def test_viewers_keep_no_place_and_no_answer_from_others(self):
        daemon = self.enterContext(Daemon(config={
            "server": [f'door_group = "{OWN_GROUP}"'], "limits": ["connections = 100"]}))
        viewers = self.enterContext(contextlib.ExitStack())

        def connect():
            plain = socket.socket(socket.AF_UNIX)
            viewers.callback(plain.close)
            plain.connect(socket_of(daemon, "viewer"))
            return plain

        for _ in range(20):
            with contextlib.suppress(OSError):
                Unreading(connect()).call(GET_DEVICE, 95)

        def answer(role, door=False):
            with channel_of(daemon, role, door) as channel:
                return call(channel, GET, ADA if door else None)[0]

        full = grpc.StatusCode.RESOURCE_EXHAUSTED
        wait_for(lambda: answer("viewer") == full, "the bound of viewers")
        self.assertEqual([answer(role) for role in ROLES[1:]], 3 * [grpc.StatusCode.OK])
        # They end by themselves.
        wait_for(lambda: answer("viewer") == grpc.StatusCode.OK, "the end of unread calls")
        for _ in range(400):
            with contextlib.suppress(OSError):
                connect()
        wait_for(lambda: any("too many are open" in line for line in daemon.said), "a line")
        self.assertEqual([answer(role, door) for role in ROLES[1:] for door in (False, True)],
                         6 * [grpc.StatusCode.OK])

    def test_who_calls_on_and_reads_nothing_is_cut_off(self):
        daemon = self.enterContext(Daemon(config={"server": [f'door_group = "{OWN_GROUP}"']}))

        def call_on(path, door):
            with socket.socket(socket.AF_UNIX) as plain:
                plain.settimeout(PATIENCE_S)
                plain.connect(socket_of(daemon, "viewer", door))
                attacker = Deaf(plain)
                for n in range(0, 100_000, 10):
                    for stream in range(n, n + 10):
                        attacker.begin_call(2 * stream + 1, True, path=path)
                        attacker.send(frame(DATA, END_STREAM, 2 * stream + 1, bytes(5)))
                    time.sleep(0.001)

        for path, door in ((GET_DEVICE, False), (ENABLE_PATH, False), (b"/nothing", False),
                           (GET_DEVICE, True)):  # the door does not say who calls
            with self.subTest(path, door=door), \
                    self.assertRaises((BrokenPipeError, ConnectionResetError)):
                call_on(path, door)
        with channel_of(daemon, "viewer") as channel:
            wait_for(lambda: call(channel, GET)[0] == grpc.StatusCode.OK, "a place for others")

    def test_a_group_that_is_not_there(self):
        config = pathlib.Path(self.enterContext(Daemon()).folder) / "groups.toml"
        config.write_text('[server]\nviewer_group = "palpate-nobody"\n')
        checked = subprocess.run([PALPATED, "--check-config", "--config", config],
                                 capture_output=True, text=True, timeout=PATIENCE_S)
        self.assertNotEqual(checked.returncode, 0)
        self.assertRegex(checked.stdout + checked.stderr,
                         r"groups.toml:2: server.viewer_group: .*palpate-nobody")

    def test_clients_take_the_highest_or_a_role(self):
        daemon = self.enterContext(Daemon())

        def info(*arguments):
            done = subprocess.run([PALPATE, "who", "--socket", daemon.socket, *arguments],
                                  capture_output=True, text=True, timeout=PATIENCE_S)
            self.assertEqual(done.returncode, 0, done.stderr)
            return re.search(r"^(\w+) +([\w ]+) \(you\)", done.stdout, re.M).groups()

        self.assertEqual(info(), ("admin", "local socket"))
        for role in ROLES[:3]:
            self.assertEqual(info("--role", role), (role, f"{role} socket"))
            with palpate.connect(daemon.socket, role=role) as conn:
                self.assertEqual(conn.device.stop().state, "stopped")  # by the stop's own socket
        for bad in ({"role": "boss"}, {"role": "viewer", "address": "localhost:7400"},
                    {"role": "viewer", "profile": "lab"}):
            with self.assertRaises(palpate.InvalidArgument):
                palpate.connect(**bad)
        # As for a user who may open no others.
        for role in ROLES[1:]:
            os.rename(socket_of(daemon, role), socket_of(daemon, role) + ".away")
        self.assertEqual(info(), ("viewer", "viewer socket"))
        with palpate.connect(daemon.socket) as conn:
            self.assertEqual(conn.address, "unix:" + socket_of(daemon, "viewer"))
            with self.assertRaises(palpate.PermissionDenied):
                conn.settings.stiffness_n_per_mm = 0.4


if __name__ == "__main__":
    unittest.main()
