"""Clients of HTTP/2 that are no library, for attacks."""

import socket
import ssl

from support import PATIENCE_S

GET_DEVICE = b"/palpate.v1.DeviceService/GetDevice"
HEADERS, DATA, SETTINGS, WINDOW_UPDATE, CONTINUATION = 1, 0, 4, 8, 9
END_HEADERS, END_STREAM = 4, 1

def header(name, value):
    """A field of HTTP/2, as it is."""
    return b"\x00" + bytes([len(name)]) + name + bytes([len(value)]) + value


def frame(kind, flags, stream, content):
    return (len(content).to_bytes(3, "big") + bytes([kind, flags]) + stream.to_bytes(4, "big")
            + content)


class Stranger:
    """Speaks HTTP/2 and follows none of its rules."""

    settings = b""

    def __init__(self, daemon, address, patience_s=PATIENCE_S):
        """Over TLS, from an address of its own."""
        plain = socket.create_connection(("127.0.0.1", daemon.port), timeout=patience_s,
                                         source_address=(address, 0))
        try:
            self.begin(daemon.tls().wrap_socket(plain, server_hostname="localhost"))
        except OSError:
            plain.close()
            raise

    def begin(self, connected):
        self.socket = connected
        self.sent_bytes = 0
        self.send(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + frame(SETTINGS, 0, 0, self.settings))

    def send(self, content):
        self.socket.sendall(content)
        self.sent_bytes += len(content)

    def become_known(self, token):
        """By a call of its own, whole and answered."""
        self.begin_call(1, is_whole=True, more=(
            (b"authorization", b"Bearer " + token.read_bytes().strip()),))
        self.send(frame(DATA, END_STREAM, 1, bytes(5)))
        self.read_until(b"application/grpc")  # in the first frame of an answer, which no window holds

    def read_until(self, part):
        self.socket.settimeout(PATIENCE_S)
        answer = b""
        while part not in answer:
            piece = self.socket.recv(65536)
            if not piece:
                raise OSError("no answer")
            answer += piece

    def answer_of(self, stream):
        """The content of the answer to a call, at whose end this returns. Its window is opened."""
        self.send(frame(WINDOW_UPDATE, 0, stream, (1 << 20).to_bytes(4, "big")))
        self.socket.settimeout(PATIENCE_S)
        content, kind, flags, of = b"", None, 0, None
        while not (of == stream and kind in (HEADERS, DATA) and flags & END_STREAM):
            head = self.read(9)
            kind, flags, of = head[3], head[4], int.from_bytes(head[5:], "big")
            part = self.read(int.from_bytes(head[:3], "big"))
            content += part if of == stream and kind == DATA else b""
        return content

    def read(self, count):
        piece = b""
        while len(piece) < count:
            more = self.socket.recv(count - len(piece))
            if not more:
                raise OSError("the connection was closed")
            piece += more
        return piece

    def begin_call(self, stream, is_whole, more=(), path=GET_DEVICE):
        fields = [(b":method", b"POST"), (b":scheme", b"https"), (b":authority", b"localhost"),
                  (b":path", path), (b"te", b"trailers"),
                  (b"content-type", b"application/grpc"), *more]
        self.send(frame(HEADERS, END_HEADERS if is_whole else 0, stream,
                        b"".join(header(*field) for field in fields)))

    def is_connected(self):
        self.socket.settimeout(0.0)
        try:
            while self.socket.recv(65536):
                pass
            return False
        except (ssl.SSLWantReadError, BlockingIOError):
            return True
        except OSError:
            return False

    def close(self):
        self.socket.close()


class Unreading(Stranger):
    """Makes calls and never opens its window for an answer."""

    settings = b"\x00\x04" + bytes(4)  # the window of each call: 0 bytes

    def __init__(self, connected, token=None):
        self.begin(connected)
        self.more = () if token is None else (
            (b"authorization", b"Bearer " + token.read_bytes().strip()),)

    def call(self, path, count, first=1):
        for stream in range(first, first + 2 * count, 2):
            self.begin_call(stream, is_whole=True, more=self.more, path=path)
            self.send(frame(DATA, END_STREAM, stream, bytes(5)))


class Deaf(Unreading):
    """Opens its windows and reads nothing at all, so that the connection itself fills."""

    settings = b"\x00\x04\x7f\xff\xff\xff"

    def begin(self, connected):
        super().begin(connected)
        self.send(frame(WINDOW_UPDATE, 0, 0, (0x7fff0000).to_bytes(4, "big")))
