"""A nats-server of a test's own, and a client that speaks its protocol over a socket: no library of
ours or of NATS judges what is on the server."""

import io
import json
import pathlib
import select
import shutil
import signal
import socket
import ssl
import subprocess
import tempfile
import threading
import time

from crash import end_in_order
from free_port import free_port
from support import PATIENCE_S, wait_until

JETSTREAM = "jetstream { max_memory_store: 2GB, max_file_store: 0 }"


class NatsServer:
    """Runs until end() or the end of a `with` block; start() after kill() keeps the port.
    config: lines of its configuration, but `listen` and the folder of JetStream. wrapper: a command
    that runs it."""

    def __init__(self, config=JETSTREAM, starts=True, wrapper=()):
        self._temporary = tempfile.TemporaryDirectory(prefix="palpate-test-")
        self.folder = pathlib.Path(self._temporary.name)
        self.port = free_port()
        self.url = f"nats://127.0.0.1:{self.port}"
        self.process = None
        self._wrapper = wrapper
        self.configure(config)
        if starts:
            self.start()

    def configure(self, config):
        """From the next start on."""
        lines = [f'listen: "127.0.0.1:{self.port}"', config]
        if "jetstream" in config:
            lines[1] = config.replace("jetstream {", f'jetstream {{ store_dir: "{self.folder}",')
        (self.folder / "nats.conf").write_text("\n".join(lines) + "\n")

    def start(self):
        program = shutil.which("nats-server") or "/usr/sbin/nats-server"
        self.process = subprocess.Popen(
            [*self._wrapper, program, "-c", str(self.folder / "nats.conf")],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.said = []
        self._reader = threading.Thread(target=self._read, args=(self.process.stderr, self.said),
                                        daemon=True)
        self._reader.start()
        ready = wait_until(lambda: any("Server is ready" in line for line in self.said) or
                           self.process.poll() is not None, 30)
        if not ready or self.process.poll() is not None:
            self.kill()
            raise RuntimeError("nats-server did not start: " + "".join(self.said))

    @staticmethod
    def _read(stream, lines):
        lines.extend(iter(stream.readline, ""))

    def stop(self):
        """It stands still; cont() lets it go on."""
        self.process.send_signal(signal.SIGSTOP)

    def cont(self):
        self.process.send_signal(signal.SIGCONT)

    def kill(self):
        self.process.kill()
        self.process.wait()
        self._close()

    def _close(self):
        self._reader.join(PATIENCE_S)
        self.process.stderr.close()

    def end(self):
        if self.process is None or self.process.returncode is not None:
            return None
        self.cont()
        # At SIGTERM it ends with 1.
        self.process.send_signal(signal.SIGINT)
        return end_in_order(self.process, PATIENCE_S, self.said, self._close)

    def client(self, *arguments, **named):
        return NatsClient(self.port, *arguments, **named)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()
        self._temporary.cleanup()


class SharedSocket(io.RawIOBase):
    """One thread reads, others write: a TLS connection takes one call at a time."""

    def __init__(self, connected):
        self._socket, self._call, self._message = connected, threading.Lock(), threading.Lock()
        connected.setblocking(False)

    def _try(self, call, argument, reads):
        while True:
            with self._call:
                try:
                    return call(argument)
                except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
                    pass
            waits = [self._socket]
            select.select(waits if reads else [], [] if reads else waits, [], PATIENCE_S)

    def readable(self):
        return True

    def readinto(self, buffer):
        return self._try(self._socket.recv_into, buffer, True)

    def sendall(self, data):
        with self._message:
            rest = memoryview(data)
            while rest:
                rest = rest[self._try(self._socket.send, rest, False):]

    def close(self):
        super().close()
        self._socket.close()


class Message:
    def __init__(self, subject, reply, headers, data):
        self.subject, self.reply, self.headers, self.data = subject, reply, headers, data

    @property
    def status(self):
        """Of an answer of the server: 404, 503, ...; 0: a message."""
        return int(self.headers.get("Status", "0").split()[0])

    @property
    def json(self):
        return json.loads(self.data)

    def __repr__(self):
        return f"{self.subject} {self.headers} {self.data[:80]!r}"


class Subscription:
    """What came: `messages`, in order."""

    def __init__(self, call):
        self.messages, self._call = [], call

    def take(self, message):
        if self._call:
            self._call(message)
        else:
            self.messages.append(message)

    def wait(self, count=1, seconds=PATIENCE_S):
        """The messages, when there are so many."""
        if not wait_until(lambda: len(self.messages) >= count, seconds):
            raise AssertionError(f"{len(self.messages)} messages, not {count}")
        return self.messages

    @property
    def newest(self):
        return self.messages[-1]


class NatsClient:
    """ca: a file, for TLS; certificate: the files of a client's certificate and key. inbox: the
    prefix of answers' subjects. `errors`: what the server refused."""

    def __init__(self, port, user=None, password=None, ca=None, certificate=None, inbox=None,
                 host="127.0.0.1"):
        self.errors, self.is_open = [], True
        self._subscriptions, self._next, self._pongs = {}, 0, 0
        self._socket = socket.create_connection((host, port), PATIENCE_S)
        # No byte more than INFO: after it TLS may begin.
        line = b""
        while not line.endswith(b"\r\n"):
            byte = self._socket.recv(1)
            if not byte:
                raise EOFError("no INFO")
            line += byte
        self.info = json.loads(line[len("INFO "):])
        if ca:
            context = ssl.create_default_context(cafile=str(ca))
            if certificate:
                context.load_cert_chain(*map(str, certificate))
            self._socket = context.wrap_socket(self._socket, server_hostname=host)
        self._shared = SharedSocket(self._socket)
        self._file = io.BufferedReader(self._shared)
        options = {"verbose": False, "pedantic": False, "lang": "test", "version": "0",
                   "protocol": 1, "headers": True, "no_responders": True}
        if user:
            options |= {"user": user, "pass": password}
        inbox = inbox or (f"_INBOX_{user}" if user else "_INBOX")
        self._inbox = f"{inbox}.{id(self):x}{time.monotonic_ns():x}"
        self._send(b"CONNECT " + json.dumps(options).encode() + b"\r\n")
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()
        self._answers = {}
        if not self.flush():
            raise PermissionError(f"not connected: {self.errors}")
        self.subscribe(self._inbox + ".*", self._take_answer)

    def _send(self, data):
        self._shared.sendall(data)

    def _follow(self):
        try:
            while True:
                line = self._file.readline()
                if not line:
                    break
                self._take(line.strip().decode())
        except (OSError, ValueError):
            pass
        self.is_open = False

    def _take(self, line):
        word, *rest = line.split()
        if word == "PING":
            self._send(b"PONG\r\n")
        elif word == "PONG":
            self._pongs += 1
        elif word == "-ERR":
            self.errors.append(line[5:].strip("'"))
        elif word in ("MSG", "HMSG"):
            head = int(rest.pop(-2)) if word == "HMSG" else 0
            body = self._file.read(int(rest[-1]) + 2)[:-2]
            subscription = self._subscriptions.get(rest[1])
            if subscription:
                subscription.take(Message(rest[0], rest[2] if len(rest) == 4 else "",
                                          self._headers(body[:head]), body[head:]))

    @staticmethod
    def _headers(head):
        if not head:
            return {}
        first, *lines = head.decode().strip().split("\r\n")
        headers = dict(line.split(": ", 1) for line in lines)
        status = first[len("NATS/1.0"):].strip()
        return headers | ({"Status": status} if status else {})

    def _take_answer(self, message):
        self._answers[message.subject] = message

    def flush(self, seconds=PATIENCE_S):
        """True when the server has taken all that was sent."""
        pongs = self._pongs
        self._send(b"PING\r\n")
        wait_until(lambda: self._pongs > pongs or not self.is_open, seconds)
        return self._pongs > pongs

    def subscribe(self, subject, call=None):
        self._next += 1
        subscription = self._subscriptions[str(self._next)] = Subscription(call)
        self._send(f"SUB {subject} {self._next}\r\n".encode())
        return subscription

    def publish(self, subject, data=b"", reply=""):
        data = data.encode() if isinstance(data, str) else data
        self._send(f"PUB {subject} {reply} {len(data)}\r\n".encode() + data + b"\r\n")

    def request(self, subject, data=b"", seconds=PATIENCE_S):
        """The answer; none: there is none in time."""
        self._next += 1
        reply = f"{self._inbox}.{self._next}"
        self.publish(subject, data, reply)
        wait_until(lambda: reply in self._answers or not self.is_open, seconds)
        return self._answers.pop(reply, None)

    def kept(self, room, subject):
        """The newest message that the room keeps of a subject below palpate.ROOM.kept; none: none.
        Where there is no stream, nobody answers."""
        answer = self.request(f"$JS.API.DIRECT.GET.PALPATE_{room}.palpate.{room}.kept.{subject}",
                              seconds=3)
        return None if answer is None or answer.status else answer

    def stream(self, room):
        """What the server says of the room's stream; none: there is none."""
        answer = self.request(f"$JS.API.STREAM.INFO.PALPATE_{room}", seconds=3)
        return None if answer is None or answer.status or "error" in answer.json else answer.json

    def close(self):
        self.is_open = False
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._thread.join(PATIENCE_S)
        self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
