"""A TCP port for a server of a test's own."""

import random
import socket


def free_port():
    """Not one of those that the kernel gives to connections (32768 and up): with other tests
    at work, such a port may be taken before it is used."""
    while True:
        port = random.SystemRandom().randrange(10000, 32768)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
                return port
            except OSError:
                pass
