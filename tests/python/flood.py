"""flood.py PORT SECONDS [CA TOKEN_FILE]: 900 connections that make 2 000 calls a second and read no
answer: a third of the time GetDevice, then GetActivity, then Follow of the facts. Prints "ready", and at the end what it sent."""

import contextlib
import pathlib
import resource
import socket
import ssl
import sys
import time

from wire import DATA, END_STREAM, GET_DEVICE, Unreading, frame

CONNECTIONS, CALLS_PER_S = 900, 2000
CALLS = ((GET_DEVICE,), (b"/palpate.v1.ActivityService/GetActivity",),
         (b"/palpate.v1.FactsService/Follow", b"\0\0\0\0\2\x0a\0", 0))  # with its start
# The daemon allows 100 at once on a connection.
MOST_STREAM = 2 * 95


class Flooder:
    """A connection that is made anew whenever it ends, or has used all its calls."""

    def __init__(self, port, tls, token):
        self._port, self._tls, self._token = port, tls, token
        self._connection = None
        self.call(GET_DEVICE)  # else it is one of too many strangers

    def connect(self):
        if self._connection is not None:
            self._connection.close()
        self._connection, self._stream = None, 1
        with contextlib.suppress(OSError):
            plain = socket.create_connection(("127.0.0.1", self._port), timeout=20)
            self._connection = (
                Unreading(plain) if self._tls is None else
                Unreading(self._tls.wrap_socket(plain, server_hostname="localhost"), self._token))

    def call(self, path, body=bytes(5), flags=END_STREAM):
        try:
            if self._connection is None or self._stream > MOST_STREAM:
                self.connect()
            one = self._connection
            one.begin_call(self._stream, is_whole=True, more=one.more, path=path)
            one.send(frame(DATA, flags, self._stream, body))
            self._stream += 2
        except (OSError, AttributeError):
            self.connect()


def main(port, seconds, ca=None, token=None):
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, 4096))
    tls = None
    if ca:
        tls = ssl.create_default_context(cafile=ca)
        tls.set_alpn_protocols(["h2"])
    flooders = [Flooder(int(port), tls, pathlib.Path(token or "")) for _ in range(CONNECTIONS)]
    print("ready", flush=True)
    began, sent, seconds = time.monotonic(), 0, float(seconds)
    while (since := time.monotonic() - began) < seconds:
        while sent < since * CALLS_PER_S:
            flooders[sent % CONNECTIONS].call(*CALLS[int(since / seconds * len(CALLS))])
            sent += 1
        time.sleep(0.001)
    print(sent, "calls", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
