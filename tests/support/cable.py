"""A way to a server that can be cut, or stand still."""

import socket
import threading


class Cable:
    """Forwards a port, until it is cut: then connections end, and there are no new ones. is_of: of
    which connections this is true, by the first bytes that the client sends; others go on. After
    `flows.clear()` connections last, and nothing passes."""

    def __init__(self, to, is_of=lambda first: True):
        self._to, self._is_of, self._ends, self.is_cut = to, is_of, [], False
        self.connections = 0
        self.flows = threading.Event()
        self.flows.set()
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port = self._door.getsockname()[1]
        self.url = f"nats://127.0.0.1:{self.port}"
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        try:
            while True:
                near, _ = self._door.accept()
                far = socket.create_connection(("127.0.0.1", self._to))
                self.connections += not self.is_cut
                for one, other, is_first in ((near, far, True), (far, near, False)):
                    threading.Thread(target=self._pump, args=(one, other, is_first),
                                     daemon=True).start()
        except OSError:
            return

    def _pump(self, one, other, is_first):
        try:
            while data := one.recv(65536):
                if is_first and self._is_of(data):
                    self._ends += [one, other]
                    if self.is_cut:
                        break
                is_first = False
                self.flows.wait()
                other.sendall(data)
        except OSError:
            pass
        for end in (one, other):
            self._end(end)

    @staticmethod
    def _end(end):
        try:
            end.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass

    def cut(self):
        self.is_cut = True
        while self._ends:
            self._end(self._ends.pop())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.flows.set()
        self.cut()
        self._door.close()
