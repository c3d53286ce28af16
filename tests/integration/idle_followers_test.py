"""A viewer, a gateway and a Python program that only follow make no call, and are told what changes.

What they send passes a relay, which counts the calls: each begins with one frame of HTTP/2.
"""

import contextlib
import os
import pathlib
import socket
import tempfile
import threading
import time
import types
import unittest

import palpate
from gateway import Gateway, Guest
from support import Daemon, wait_until
from view_support import Screen, Window

PREFACE, FRAME_HEAD, HEADERS = 24, 9, 1
SETTLE_S, IDLE_S = 3.0, 10.0


class Relay:
    """A socket in front of a daemon's. `calls`: how many began on all connections."""

    def __init__(self, folder, daemon):
        self.socket, self.calls = str(folder / "relay.sock"), 0
        self._to, self._sockets = daemon.socket, []
        self._door = socket.socket(socket.AF_UNIX)
        self._door.bind(self.socket)
        self._door.listen()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._door.accept()
                far = socket.socket(socket.AF_UNIX)
                far.connect(self._to)
                self._sockets += near, far
                for way in ((near, far, True), (far, near, False)):
                    threading.Thread(target=self._carry, args=way, daemon=True).start()

    def _carry(self, source, sink, is_counted):
        skip, head = PREFACE, b""  # of what comes next: to pass over, and a frame's begun head
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)
                while is_counted and data:
                    passed = min(skip, len(data))
                    skip, data = skip - passed, data[passed:]
                    if not skip and data:
                        need = FRAME_HEAD - len(head)
                        head, data = head + data[:need], data[need:]
                        if len(head) == FRAME_HEAD:
                            self.calls += head[3] == HEADERS
                            skip, head = int.from_bytes(head[:3], "big"), b""
            sink.shutdown(socket.SHUT_RDWR)

    def close(self):
        for each in (self._door, *self._sockets):
            each.close()


class IdleFollowersTest(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.daemon = self.enterContext(Daemon())

    def relay(self, name):
        (self.folder / name).mkdir()
        relay = Relay(self.folder / name, self.daemon)
        self.addCleanup(relay.close)
        return relay

    def test_nobody_asks_again(self):
        relays = {name: self.relay(name) for name in ("viewer", "gateway", "python")}
        window = Window(self.enterContext(Screen()), self.folder, "--socket",
                        relays["viewer"].socket)
        self.addCleanup(window.end)
        gateway = self.enterContext(Gateway(types.SimpleNamespace(socket=relays["gateway"].socket)))
        guest = self.enterContext(Guest(gateway))
        conn = self.enterContext(palpate.connect(relays["python"].socket))
        heard = []
        facts = conn.facts()

        def follow():
            with contextlib.suppress(palpate.Error):
                heard.extend(facts)

        threading.Thread(target=follow, daemon=True).start()
        window.wait_for_title("Palpate: builtin:sphere:48")
        guest.wait_for("settings")
        self.assertTrue(wait_until(lambda: heard))
        time.sleep(SETTLE_S)
        before, told = {name: relay.calls for name, relay in relays.items()}, len(heard)
        for name, calls in before.items():
            self.assertGreaterEqual(calls, 1, name)
        time.sleep(IDLE_S)
        self.assertEqual({name: relay.calls for name, relay in relays.items()}, before)
        self.assertGreater(len(heard), told)  # counts and ages, each second
        # They follow: nobody was asked, and all know.
        with self.daemon.connect() as other:
            other.settings.stiffness_n_per_mm = 0.625
        guest.wait_for("settings", lambda now: now.settings.stiffness_n_per_mm == 0.625)
        self.assertTrue(wait_until(
            lambda: heard[-1].settings["stiffness_n_per_mm"] == 0.625))
        self.assertEqual({name: relay.calls for name, relay in relays.items()}, before)


if __name__ == "__main__":
    os.environ.pop("PALPATE_SERVER", None)
    unittest.main()
