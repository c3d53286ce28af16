"""Floods of palpated by clients of HTTP/2 that follow no rules. Prints "ready", and at the end what
it sent. Default: 900 connections that make 2 000 calls a second and read no answer: GetDevice,
GetActivity and Follow of the facts by turns.

--method PATH[=BODY_HEX[+]]: the calls in their place, by turns; "+": the call goes on, by a byte of
    its next message.
--reads: answers are read. --resets: each call is reset at once. --again: a connection for each call.
--handshakes: instead of calls, TLS handshakes. --stop-socket PATH: instead, connections to the
    emergency stop's socket that say nothing, half a word, something else, or stop."""

import argparse
import contextlib
import itertools
import pathlib
import resource
import socket
import ssl
import time

from wire import DATA, END_STREAM, GET_DEVICE, Deaf, Unreading, frame

CALLS = ((GET_DEVICE,), (b"/palpate.v1.ActivityService/GetActivity",),
         (b"/palpate.v1.FactsService/Follow", b"\0\0\0\0\2\x0a\0", 0))  # with its start
RST_STREAM, CANCEL = 3, bytes([0, 0, 0, 8])
# The daemon allows 100 at once on a connection.
MOST_STREAM = 2 * 95
TURN_S = 0.3
HELD = 200  # connections to the stop's socket that stay open


def connected(at, patience_s):
    if at.isdigit():
        return socket.create_connection(("127.0.0.1", int(at)), timeout=patience_s)
    plain = socket.socket(socket.AF_UNIX)
    plain.settimeout(patience_s)
    plain.connect(at)
    return plain


class Reading(Deaf):
    """Reads what has come whenever it sends."""

    def __init__(self, connected, token=None):
        connected.setblocking(False)
        super().__init__(connected, token)

    def send(self, content):
        with contextlib.suppress(BlockingIOError, ssl.SSLWantReadError):
            while self.socket.recv(65536):
                pass
        super().send(content)


class Flooder:
    """A connection that is made anew whenever it ends, or has used all its calls."""

    def __init__(self, options, tls):
        self._options, self._tls = options, tls
        self._connection = None
        self.call(GET_DEVICE)  # else it is one of too many strangers

    def connect(self):
        if self._connection is not None:
            self._connection.close()
        self._connection, self._stream = None, 1
        with contextlib.suppress(OSError):
            plain = connected(self._options.at, 20)
            kind = Reading if self._options.reads else Unreading
            self._connection = (
                kind(plain) if self._tls is None else
                kind(self._tls.wrap_socket(plain, server_hostname="localhost"),
                     self._options.token))

    def call(self, path, body=bytes(5), flags=END_STREAM):
        try:
            if self._connection is None or self._stream > MOST_STREAM or self._options.again:
                self.connect()
            one = self._connection
            one.begin_call(self._stream, is_whole=True, more=one.more, path=path)
            one.send(frame(DATA, flags, self._stream, body))
            if self._options.resets:
                one.send(frame(RST_STREAM, 0, self._stream, CANCEL))
            elif flags == 0:  # goes on, by a byte
                one.send(frame(DATA, 0, self._stream, b"\0"))
            self._stream += 2
        except (OSError, AttributeError):
            self.connect()


def calls_of(methods):
    for method in methods:
        path, _, body = method.partition("=")
        goes_on = body.endswith("+")
        content = bytes.fromhex(body.rstrip("+"))
        message = b"\0" + len(content).to_bytes(4, "big") + content
        yield path.encode(), message, 0 if goes_on else END_STREAM


def shake_hands(options, tls):
    while True:
        with contextlib.suppress(OSError), \
                connected(options.at, 5) as plain:
            tls.wrap_socket(plain, server_hostname="localhost").close()
        yield


def ask_to_stop(path):
    held = []
    for n in itertools.count():
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(1.0)
        with contextlib.suppress(OSError):
            connection.connect(path)
            connection.sendall((b"", b"sto", b"GET / HTTP/1.1\r\n", b"stop\n")[n % 4])
        held.append(connection)
        if len(held) > HELD:
            held.pop(0).close()
        yield


def call_all(options, tls):
    calls = tuple(calls_of(options.method)) or CALLS
    flooders = [Flooder(options, tls) for _ in range(options.connections)]
    began = time.monotonic()
    for n in itertools.count():
        turn = int((time.monotonic() - began) / TURN_S)
        flooders[n % len(flooders)].call(*calls[turn % len(calls)])
        yield


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("at", help="a port of this machine, or a socket")
    parser.add_argument("seconds", type=float)
    parser.add_argument("ca", nargs="?")
    parser.add_argument("token", nargs="?", type=pathlib.Path)
    parser.add_argument("--connections", type=int, default=900)
    parser.add_argument("--per-s", type=int, default=2000)
    parser.add_argument("--method", action="append", default=[])
    for flag in ("--reads", "--resets", "--again", "--handshakes"):
        parser.add_argument(flag, action="store_true")
    parser.add_argument("--stop-socket")
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, 4096))
    tls = None
    if options.ca:
        tls = ssl.create_default_context(cafile=options.ca)
        tls.set_alpn_protocols(["h2"])
    acts = (ask_to_stop(options.stop_socket) if options.stop_socket else
            shake_hands(options, tls) if options.handshakes else call_all(options, tls))
    next(acts)
    print("ready", flush=True)
    began, sent = time.monotonic(), 0
    while (since := time.monotonic() - began) < options.seconds:
        while sent < since * options.per_s and time.monotonic() - began < options.seconds:
            next(acts)
            sent += 1
        time.sleep(0.001)
    print(sent, "calls", flush=True)


if __name__ == "__main__":
    main()
