"""How a gateway reaches its NATS server: over TLS only the right one, and again and again."""

import pathlib
import tempfile
import unittest
import urllib.request

from authority import Authority
from free_port import free_port
from gateway import Gateway, Guest
from nats import NatsServer
from support import wait_until


class LinkTest(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.server = self.enterContext(NatsServer("", starts=False))

    def serve(self, *lines):
        self.server.end()
        self.server.configure("\n".join(lines))
        self.server.start()

    def follow(self, url, *lines):
        """A gateway that receives a room, and a guest there."""
        self.metrics = f"127.0.0.1:{free_port()}"
        gateway = self.enterContext(Gateway(None, ("--from", url, "--room", "hall",
                                                   "--metrics", self.metrics),
                                            "\n".join(["[nats]", *lines])))
        return self.enterContext(Guest(gateway))

    def require_refused(self, words):
        """The server says so, more than once: libnats by itself gives up after the second time."""
        self.assertTrue(wait_until(
            lambda: sum(words in line for line in self.server.said) > 4), self.server.said)

    def is_counted_as_connected(self):
        with urllib.request.urlopen(f"http://{self.metrics}/metrics") as answer:
            lines = answer.read().decode().splitlines()
        return [line for line in lines if line.startswith("palpate_web_nats_connected")] == [
            "palpate_web_nats_connected 1"]

    def require_reached(self, guest):
        guest.wait_for("connection", lambda message: "publishes" in message["why"])
        self.assertTrue(wait_until(self.is_counted_as_connected))

    def was_reached(self, guest):
        return self.is_counted_as_connected() or any("publishes" in text.get("why", "") for text in guest.heard)

    def test_only_a_server_with_a_certificate_of_the_authority_for_its_name_is_used(self):
        ours, others = Authority(self.folder, "ours"), Authority(self.folder, "others")
        right, of_others, elsewhere = (
            authority.issue(name, f"DNS:{host}", purpose="serverAuth") for authority, name, host in (
                (ours, "right", "localhost"), (others, "of-others", "localhost"),
                (ours, "elsewhere", "nats.example.org")))
        client = ours.issue("client", "DNS:client")
        guest = self.follow(f"tls://localhost:{self.server.port}", f'tls_ca = "{ours.ca}"',
                            f'tls_cert = "{client[0]}"', f'tls_key = "{client[1]}"')
        tls = 'tls {{ cert_file: "{}", key_file: "{}", ca_file: "{}", verify: true }}'
        for certificate in (of_others, elsewhere):
            self.serve(tls.format(*certificate, ours.ca))
            self.require_refused("TLS handshake error")
            self.assertFalse(self.was_reached(guest), certificate)
        # Nor is there plain text for a server that asks for no TLS.
        self.serve("debug: true")
        self.require_refused("Client connection created")
        self.assertFalse(self.was_reached(guest))
        self.serve(tls.format(*right, ours.ca))
        self.require_reached(guest)

    def test_a_server_that_refuses_the_password_is_asked_until_it_does_not(self):
        password = self.folder / "password"
        password.write_text("secret\n")
        password.chmod(0o600)
        guest = self.follow(self.server.url, 'user = "lyon"', f'password_file = "{password}"')
        user = 'authorization {{ user: lyon, password: {} }}'
        self.serve(user.format("other"))
        self.require_refused("authentication error")
        self.assertFalse(self.was_reached(guest))
        self.serve(user.format("secret"))
        self.require_reached(guest)


if __name__ == "__main__":
    unittest.main()
