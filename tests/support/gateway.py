"""A palpate-web of a test's own, and guests: HTTP and WebSocket without a browser."""

import base64
import http.client
import json
import os
import pathlib
import socket
import struct
import subprocess
import tempfile
import threading

import numpy as np
import xxhash
import zstandard

from palpate.v1 import envelope_pb2

from crash import end_in_order
from free_port import free_port
from support import PATIENCE_S, wait_until

PALPATE_WEB = os.environ.get("PALPATE_WEB", "")
# By the order of LeafType, which is part of the names of groups.
VOXEL_TYPES = ["uint8", "int16", "uint16", "float32"]


class Gateway:
    """Runs until end() or the end of a `with` block. daemon: none for a gateway that has no palpated.
    more: more arguments. wrapper: a command that runs it. key: the room's; a new one at every start
    unless given."""

    def __init__(self, daemon, more=(), config="", wrapper=(), key=None):
        self._temporary = tempfile.TemporaryDirectory(prefix="palpate-test-")
        folder = pathlib.Path(self._temporary.name)
        (folder / "index.html").write_text("<!doctype html>")
        (folder / "web.toml").write_text(config)
        (folder / "web.toml").chmod(0o600)
        if key:
            (folder / "room-key").write_text(key)
            (folder / "room-key").chmod(0o600)
            more = [*more, "--room-key-file", str(folder / "room-key")]
        self._key, self.port = key, free_port()
        self.command = [*wrapper, PALPATE_WEB, "--config", str(folder / "web.toml"),
                        *(["--socket", daemon.socket] if daemon else []),
                        "--listen", f"127.0.0.1:{self.port}", "--page", str(folder), *more]
        self.start()

    def start(self):
        self.process = subprocess.Popen(self.command, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, text=True)
        self.said = []
        self._reader = threading.Thread(target=lambda: self.said.extend(self.process.stderr),
                                        daemon=True)
        self._reader.start()
        link = self.link = self.process.stdout.readline()
        if "#room=" not in link:
            self.end()
            raise RuntimeError("palpate-web did not start: " + "".join(self.said))
        self.room = self._key or link.strip().rpartition("=")[2]

    def end(self):
        """The exit status."""
        if self.process.poll() is None:
            self.process.terminate()

        def close():
            self._reader.join(PATIENCE_S)
            self.process.stderr.close()
            self.process.stdout.close()

        return end_in_order(self.process, PATIENCE_S, self.said, close)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()
        self._temporary.cleanup()

    def ask(self, method, path, body=None, **headers):
        """Status, headers and body of the answer."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.request(method, path, body, {"Host": f"localhost:{self.port}"} | {
                name.replace("_", "-"): value for name, value in headers.items()})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    @property
    def origin(self):
        return f"http://localhost:{self.port}"


class Guest:
    """Logs in and follows /stream on a thread of its own: in `topics` the newest text of each type
    and the newest message of each fact; the newest pose's Envelope; all manifests' names; all texts,
    and facts as {"type": name, "fact": message}."""

    def __init__(self, gateway, **login):
        self.gateway = gateway
        self.topics, self.manifests, self.pose, self.poses = {}, [], None, 0
        self.heard, self._callbacks = [], {}
        status, headers, body = gateway.ask(
            "POST", "/login", json.dumps(login or {"room": gateway.room}), Origin=gateway.origin,
            Content_Type="application/json")
        if status != 200:
            raise RuntimeError(f"no login: {status} {body!r}")
        self.cookie = headers["Set-Cookie"].partition(";")[0]
        self._socket = socket.create_connection(("127.0.0.1", gateway.port), PATIENCE_S)
        self._received = b""
        self._socket.sendall(
            f"GET /stream HTTP/1.1\r\nHost: localhost:{gateway.port}\r\nOrigin: {gateway.origin}\r\n"
            f"Cookie: {self.cookie}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
            .encode())
        while b"\r\n\r\n" not in self._received:
            self._receive()
        head, _, self._received = self._received.partition(b"\r\n\r\n")
        if b" 101 " not in head.partition(b"\r\n")[0]:
            raise RuntimeError(f"no stream: {head!r}")
        self.is_open = True
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def _receive(self):
        more = self._socket.recv(65536)
        if not more:
            raise EOFError
        self._received += more

    def _take_bytes(self, count):
        while len(self._received) < count:
            self._receive()
        taken, self._received = self._received[:count], self._received[count:]
        return taken

    def _follow(self):
        try:
            while True:
                kind, length = self._take_bytes(2)
                if length == 126:
                    length, = struct.unpack(">H", self._take_bytes(2))
                elif length == 127:
                    length, = struct.unpack(">Q", self._take_bytes(8))
                self._hear(kind & 15, self._take_bytes(length))
        except (EOFError, OSError):
            self.is_open = False

    def _hear(self, kind, message):
        if kind == 1:
            text = json.loads(message)
            self._take(text["type"], text, text)
            if text["type"] == "manifest":
                self.manifests.append(text["name"])
        elif kind == 2:
            envelope = envelope_pb2.Envelope.FromString(message)
            for fact, told in envelope.facts.ListFields():
                self._take(fact.name, told, {"type": fact.name, "fact": told})
            if envelope.WhichOneof("what") != "pose":
                return
            self.pose = envelope
            self.poses += 1
            if self.poses % 8 == 0:
                self.send({"type": "ack", "sequence": envelope.sequence})

    def _take(self, topic, message, heard):
        self.topics[topic] = message
        self.heard.append(heard)
        self._callbacks.get(topic, lambda message: None)(message)

    def on_text(self, topic, call):
        """Calls it on the guest's thread with the topic's text now, if there is one, and with each
        later one."""
        self._callbacks[topic] = call
        if topic in self.topics:
            call(self.topics[topic])

    def send(self, message):
        """Up to 125 bytes of JSON, masked with zeros."""
        text = json.dumps(message).encode()
        self._socket.sendall(bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text)

    def steer(self, key, value):
        """The error; empty: done."""
        self.topics.pop("steered", None)
        self.send({"type": "steer", "id": 1, "key": key, "value": value})
        self.wait_for("steered")
        return self.topics["steered"]["error"]

    def wait_for(self, topic, holds=lambda message: True):
        if not wait_until(lambda: topic in self.topics and holds(self.topics[topic])):
            raise AssertionError(f"{topic}: {self.topics.get(topic)}")
        return self.topics[topic]

    def blob(self, name):
        """Its bytes; none: the gateway does not keep it."""
        status, headers, body = self.gateway.ask("GET", f"/volume/{name}", Cookie=self.cookie,
                                                 Accept_Encoding="zstd")
        if status == 410:
            return None
        if status != 200:
            raise AssertionError(f"{name}: {status} {body!r}")
        if headers["Content-Encoding"] == "zstd":
            return zstandard.ZstdDecompressor().decompress(body)
        return body

    def close(self):
        self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(PATIENCE_S)
        self._socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class Copy:
    """The voxels that a manifest names. groups: those of before by name, which are not fetched."""

    def __init__(self, guest, manifest, groups):
        lattice = manifest["lattice"]
        kind = VOXEL_TYPES.index(lattice["voxel_type"])
        dtype = np.dtype(lattice["voxel_type"]).newbyteorder("<")
        size = lattice["size"]
        count = [-(-axis // 32) for axis in size]
        names = base64.b64decode(manifest["groups"])
        whole = np.full([32 * axis for axis in count], lattice["background"], dtype)
        self.lost = False
        for number, place in enumerate(np.ndindex(*count)):
            name = names[16 * number:16 * number + 16]
            if name == bytes(16):
                continue
            if name not in groups:
                voxels = guest.blob(name.hex())
                if voxels is None:
                    self.lost = True
                    return
                if xxhash.xxh3_128_digest(bytes([kind]) + voxels) != name:
                    raise AssertionError("a group is not what its name says")
                groups[name] = np.frombuffer(voxels, dtype).reshape(32, 32, 32)
            begin = [32 * axis for axis in place]
            whole[tuple(slice(at, at + 32) for at in begin)] = groups[name]
        bricks = [-(-axis // 8) for axis in size]
        self.bricks = (whole[tuple(slice(8 * axis) for axis in bricks)]
                       .reshape(bricks[0], 8, bricks[1], 8, bricks[2], 8)
                       .transpose(0, 2, 4, 1, 3, 5).reshape(-1, 512))
        self.voxels = whole[tuple(slice(axis) for axis in size)]
