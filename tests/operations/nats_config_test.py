"""deploy/nats: nats-server as the guide sets it up, a hub and a leaf server, with TLS, and accounts
that `palpate-web nats-user` printed. What others than their users may do is refused."""

import json
import os
import pathlib
import signal
import socket
import ssl
import subprocess
import tempfile
import unittest

from authority import Authority
from free_port import free_port
from nats import NatsServer
from support import PATIENCE_S, wait_until

SHIPPED = pathlib.Path(__file__).resolve().parents[2] / "deploy/nats"
HOST = "DNS:localhost,IP:127.0.0.1"


class ShippedServer(NatsServer):
    """name: hub or leaf. files: those that the configuration names, as text or a path to copy."""

    def __init__(self, name, files):
        self.name, self.files = name, files
        self.leaf_port = free_port()
        super().__init__()

    def configure(self, config):
        text = (SHIPPED / f"{self.name}.conf").read_text()
        for shipped, here in (("/etc/nats-server/", f"{self.folder}/nats-server/"),
                              ("/run/nats-server", str(self.folder / "store")),
                              ("0.0.0.0:4222", f"127.0.0.1:{self.port}"),
                              ("0.0.0.0:7422", f"127.0.0.1:{self.leaf_port}")):
            text = text.replace(shipped, here)
        (self.folder / "nats.conf").write_text(text)
        (self.folder / "nats-server").mkdir(exist_ok=True)
        for file, source in self.files.items():
            content = source if isinstance(source, str) else source.read_text()
            (self.folder / "nats-server" / file).write_text(content)


def new_user(name, room, *more):
    """Password, and an account for accounts.conf."""
    said = subprocess.run([os.environ["PALPATE_WEB"], "nats-user", name, "--room", room, *more],
                          check=True, capture_output=True, text=True).stdout
    first, _, account = said.partition("\n")
    return first.rpartition(" ")[2], account


def users_of(account):
    """As the guide's sed."""
    return subprocess.run(["sed", "-n", "/users: /,/}]/p"], input=account, check=True,
                          capture_output=True, text=True).stdout


def stream(room, **more):
    """As palpate-web makes it."""
    return json.dumps({
        "name": f"PALPATE_{room}", "subjects": [f"palpate.{room}.kept.>"], "storage": "memory",
        "retention": "limits", "discard": "old", "max_msgs_per_subject": 1, "num_replicas": 1,
        "max_consumers": 1, "allow_direct": True} | more)


class Servers:
    def __init__(self, folder):
        clients, leaves = Authority(folder, "servers"), Authority(folder, "leaves")
        self.ca = clients.ca
        hub, leaf = (clients.issue(name, HOST, purpose="serverAuth") for name in ("hub", "site"))
        self.leaf_certificate = leaves.issue("leaf", HOST)
        self.passwords, self.accounts = {}, ""
        for name, room, *more in (("or-2", "hall", "--publishes"), ("site-a", "hall"),
                                  ("or-3", "other", "--publishes")):
            self.passwords[name], account = new_user(name, room, *more)
            self.accounts += account
            if name == "site-a":
                site_users = users_of(account)
        self.hub = ShippedServer("hub", {"cert.pem": hub[0], "key.pem": hub[1],
                                         "leaf-ca.pem": leaves.ca, "accounts.conf": self.accounts})
        # Whoever rules the leaf server may write what they like into its files.
        wide = '{ user: "wide", password: "wide", permissions: { publish: ">", subscribe: ">" } }'
        bare = '{ user: "bare", password: "bare" }'
        remote = f'url: "tls://site-a:{self.passwords["site-a"]}@localhost:{self.hub.leaf_port}"\n'
        self.leaf = ShippedServer("leaf", {
            "cert.pem": leaf[0], "key.pem": leaf[1], "leaf.pem": self.leaf_certificate[0],
            "leaf.key": self.leaf_certificate[1], "hub-ca.pem": clients.ca, "remote.conf": remote,
            "users.conf": site_users.replace("[{", f"[{wide}, {bare}, {{", 1)})

    def end(self):
        for server in (self.leaf, self.hub):
            server.__exit__()

    def client(self, server, user):
        return server.client(user, self.passwords[user], ca=self.ca)

    def make_room(self, hub, user, room):
        """The room's publisher, with its stream."""
        publisher = self.client(hub, user)
        made = publisher.request(f"$JS.API.STREAM.CREATE.PALPATE_{room}", stream(room))
        if "error" in made.json:
            raise RuntimeError(made.json)
        return publisher


class ConfigTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="palpate-test-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.servers = Servers(cls.folder.name)
        cls.addClassCleanup(cls.servers.end)

    def context(self, certificate=None):
        context = ssl.create_default_context(cafile=str(self.servers.ca))
        if certificate:
            context.load_cert_chain(*map(str, certificate))
        return context

    def answer(self, port, said, context=None):
        """What the server says to a stranger after its INFO; nothing: it only hung up."""
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as stranger:
            self.assertTrue(stranger.recv(65536).startswith(b"INFO "))
            try:
                if context:
                    stranger = context.wrap_socket(stranger, server_hostname="localhost")
                stranger.sendall(said)
                return stranger.recv(65536)
            except OSError:
                return b""

    def both(self):
        for server in (self.servers.hub, self.servers.leaf):
            with self.subTest(server=server.name):
                yield server

    def test_nobody_comes_in_without_tls_or_without_a_user_and_its_password(self):
        password = self.servers.passwords["site-a"]
        hello = f'CONNECT {{"user": "site-a", "pass": "{password}"}}\r\nPING\r\n'.encode()
        for server in self.both():
            self.assertEqual(self.answer(server.port, hello), b"")
            for user, password in ((None, None), ("site-a", "wrong"), ("nobody", "")):
                with self.assertRaises(PermissionError):
                    server.client(user, password, ca=self.servers.ca)

    def test_tls_is_1_2_or_newer(self):
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        context.set_ciphers("DEFAULT@SECLEVEL=0")
        context.options &= ~(ssl.OP_NO_TLSv1 | ssl.OP_NO_TLSv1_1)
        context.options |= ssl.OP_NO_TLSv1_2 | ssl.OP_NO_TLSv1_3
        for server in self.both():
            self.assertEqual(self.answer(server.port, b"PING\r\n", context), b"")

    def test_no_other_port_is_open_and_no_websocket_on_these(self):
        upgrade = (b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
                   b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n")
        for server, ports in ((self.servers.hub, {self.servers.hub.port, self.servers.hub.leaf_port}),
                              (self.servers.leaf, {self.servers.leaf.port})):
            listening = subprocess.run(["ss", "-Hltnp"], check=True, capture_output=True, text=True)
            self.assertEqual({int(line.split()[3].rpartition(":")[2])
                              for line in listening.stdout.splitlines()
                              if f"pid={server.process.pid}," in line}, ports)
            self.assertNotIn(b"101", self.answer(server.port, upgrade, self.context()))

    def test_while_no_account_is_there_nobody_comes_in(self):
        for server, file in ((self.servers.hub, "accounts.conf"),
                             (self.servers.leaf, "users.conf")):
            with self.subTest(server=server.name):
                empty = ShippedServer(server.name, server.files | {file: ""})
                self.addCleanup(empty.__exit__)
                for user in (None, "nobody", "site-a"):
                    with self.assertRaises(PermissionError):
                        empty.client(user, "", ca=self.servers.ca)

    def test_an_account_that_is_added_or_removed_counts_after_a_reload(self):
        hub = ShippedServer("hub", self.servers.hub.files)
        self.addCleanup(hub.__exit__)

        def reload(accounts):
            (hub.folder / "nats-server/accounts.conf").write_text(accounts)
            # New accounts have what they import after the second time.
            for _ in range(2):
                count = len(hub.said)
                hub.process.send_signal(signal.SIGHUP)
                self.assertTrue(wait_until(lambda: any(
                    "Reloaded server configuration" in line for line in hub.said[count:])))
        publisher = self.enterContext(self.servers.make_room(hub, "or-2", "hall"))
        publisher.request("palpate.hall.kept.group.1", b"voxels")
        password, account = new_user("site-b", "hall")
        reload(self.servers.accounts + account)
        site = self.enterContext(hub.client("site-b", password, ca=self.servers.ca))
        self.assertEqual(site.kept("hall", "group.1").data, b"voxels")
        self.assertTrue(publisher.is_open)
        reload(self.servers.accounts)
        self.assertTrue(wait_until(lambda: not site.is_open))
        with self.assertRaises(PermissionError):
            hub.client("site-b", password, ca=self.servers.ca)
        # The stream is still the one of before.
        self.assertEqual(publisher.request("palpate.hall.kept.group.1", b"more").json["seq"], 2)

    def test_a_user_without_permissions_may_do_nothing_at_a_leaf_server(self):
        with self.servers.leaf.client("bare", "bare", ca=self.servers.ca) as client:
            client.subscribe("palpate.hall.live.pose")
            client.publish("palpate.hall.live.pose", b"")
            client.flush()
            # The first: the client's own inbox.
            self.assertEqual(len(client.errors), 3, client.errors)

    def test_no_publisher_keeps_what_is_of_another_room_or_on_disk(self):
        judged = self.servers.accounts.replace("[{", '[{ user: "judge", password: "j" }, {', 1)
        hub = ShippedServer("hub", self.servers.hub.files | {"accounts.conf": judged})
        self.addCleanup(hub.__exit__)
        other = self.enterContext(self.servers.make_room(hub, "or-3", "other"))
        publisher = self.enterContext(self.servers.client(hub, "or-2"))
        judge = self.enterContext(hub.client("judge", "j", ca=self.servers.ca))
        outside = {"api": "$JS.palpate.other.API", "deliver": "palpate.other.kept"}
        copied = ({"name": "PALPATE_other"}, {"name": "PALPATE_other", "external": outside})

        def kept():
            """Subjects of the room's stream."""
            said = judge.request("$JS.API.STREAM.INFO.PALPATE_hall", '{"subjects_filter": ">"}')
            return list(said.json.get("state", {}).get("subjects", ()))
        for more in ({"storage": "file"}, {"subjects": ["palpate.other.kept.>"]},
                     {"subjects": [">"]}, *({"mirror": one, "subjects": []} for one in copied),
                     *({"sources": [one]} for one in copied)):
            with self.subTest(**more):
                made = publisher.request("$JS.API.STREAM.CREATE.PALPATE_hall",
                                         stream("hall", **more))
                self.assertEqual("error" in made.json, "storage" in more)
                other.request("palpate.other.kept.group.1", b"voxels of the other room")
                # A stream that copies begins at once.
                self.assertFalse(wait_until(lambda: any(".other." in one for one in kept()), 1))
                judge.request("$JS.API.STREAM.DELETE.PALPATE_hall")

    def test_a_message_of_more_than_a_mebibyte_and_an_endless_line_end_the_connection(self):
        for said in (b"PUB palpate.hall.live.pose %d\r\n" % (2**20 + 1), b"PUB " + b"a" * 5000):
            client = self.servers.client(self.servers.hub, "or-2")
            client._send(said)
            self.assertTrue(wait_until(lambda: not client.is_open))
            client.close()

    def test_the_leaf_port_reads_nothing_from_who_has_no_certificate_of_the_leaf_authority(self):
        port = self.servers.hub.leaf_port
        hello = b'CONNECT {"user": "site-a", "pass": "wrong"}\r\n'
        self.assertEqual(self.answer(port, hello), b"")
        self.assertEqual(self.answer(port, hello, self.context()), b"")
        self.assertIn(b"Authorization",
                      self.answer(port, hello, self.context(self.servers.leaf_certificate)))

    def test_a_site_hears_asks_and_steers_through_its_leaf_server(self):
        with self.servers.make_room(self.servers.hub, "or-2", "hall") as publisher, \
                self.servers.client(self.servers.leaf, "site-a") as gateway:
            publisher.subscribe("palpate.hall.steer.*",
                                lambda ask: publisher.publish(ask.reply, b"done"))
            live = gateway.subscribe("palpate.hall.live.>")
            publisher.request("palpate.hall.kept.group.7", b"voxels")
            self.assertTrue(wait_until(lambda: gateway.kept("hall", "group.7") is not None))
            self.assertEqual(gateway.kept("hall", "group.7").data, b"voxels")
            self.assertEqual(gateway.request(
                "$JS.API.DIRECT.GET.PALPATE_hall.palpate.hall.kept.group.8").status, 404)
            self.assertTrue(wait_until(lambda: publisher.publish(
                "palpate.hall.live.pose", b"pose") or live.messages))
            self.assertEqual(live.newest.data, b"pose")
            self.assertTrue(wait_until(lambda: (said := gateway.request(
                "palpate.hall.steer.site-a", b"{}", 3)) and said.data == b"done"))

    def test_whoever_rules_a_leaf_server_may_do_there_what_the_site_may_and_nothing_else(self):
        with self.servers.make_room(self.servers.hub, "or-2", "hall") as publisher, \
                self.servers.leaf.client("wide", "wide", ca=self.servers.ca) as wide:
            heard = [publisher.subscribe(subject) for subject in
                     ("palpate.hall.steer.*", "palpate.hall.live.beat")]
            publisher.request("palpate.hall.kept.group.9", b"voxels")
            publisher.flush()
            everything = wide.subscribe(">")
            # Each server has heard of the other's subscriptions when messages come through.
            self.assertTrue(wait_until(lambda: publisher.publish(
                "palpate.hall.live.pose", b"pose") or everything.messages))
            self.assertTrue(wait_until(lambda: wide.publish(
                "palpate.hall.steer.site-a", b"first") or heard[0].messages))
            for subject in ("palpate.hall.steer.site-b", "palpate.hall.live.beat",
                            "palpate.hall.kept.group.9", "$JS.API.STREAM.PURGE.PALPATE_hall",
                            "$JS.API.STREAM.DELETE.PALPATE_hall", "$JS.API.INFO",
                            "$JS.API.STREAM.CREATE.PALPATE_mine", "$SYS.REQ.ACCOUNT.PING.CONNZ",
                            "$JS.API.DIRECT.GET.PALPATE_hall.palpate.other.kept.group.9"):
                wide.publish(subject, b"x", "_INBOX_site-a.attack")
            # Nobody checks where the sender of a request wants the answer.
            for reply in ("$JS.API.STREAM.PURGE.PALPATE_hall", "palpate.hall.kept.group.9",
                          "palpate.other.kept.group.9", "palpate.hall.live.beat"):
                wide.publish("$JS.API.DIRECT.GET.PALPATE_hall.palpate.hall.kept.group.9", b"",
                             reply)
                wide.publish("palpate.hall.steer.site-a", b"first", reply)
            # After them in order: when it has come, the others would have.
            wide.publish("palpate.hall.steer.site-a", b"last")
            steered = heard[0].messages
            self.assertTrue(wait_until(lambda: steered[-1].data == b"last"))
            self.assertEqual({message.data for message in steered}, {b"first", b"last"})
            self.assertEqual(heard[1].messages, [])
            # Of the servers only their own one may answer.
            self.assertEqual([message for message in everything.messages
                              if message.subject == "_INBOX_site-a.attack"
                              and b"palpate-site-a" not in message.data], [])
            with self.servers.client(self.servers.hub, "site-a") as site:
                self.assertEqual(site.kept("hall", "group.9").data, b"voxels")
            for message in ("palpate.other.live.pose", "_INBOX_or-2.x"):
                publisher.publish(message, b"not for the site")
            publisher.publish("palpate.hall.live.pose", b"for the site")
            self.assertTrue(wait_until(lambda: any(
                message.data == b"for the site" for message in everything.messages)))
            self.assertNotIn(b"not for the site", [m.data for m in everything.messages])


if __name__ == "__main__":
    unittest.main()
