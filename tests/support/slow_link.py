"""A long cable between two network namespaces: it delays each packet and drops some at random, in
both directions. For kernels without netem, in userland over two TUN devices.

As a program, it is the cable: in the namespace of one end, as root of both namespaces,

    slow_link.py PID --name DEVICE --near ADDRESS/BITS --far ADDRESS/BITS

PID: a process in the namespace of the other end. Prints "ready", then lives until it is ended; on
SIGTERM it prints how many packets and bytes it took and how many it dropped, as JSON. --near and
--far: the addresses of the two ends; the devices have the same name.

At most QUEUE_BYTES are under way in each direction; what comes then is dropped, as at a router."""

import argparse
import collections
import ctypes
import fcntl
import json
import os
import random
import select
import signal
import struct
import subprocess
import sys
import time

from crash import require_an_end

TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 1, 0x1000
CLONE_NEWNET = 0x40000000
QUEUE_BYTES = 16 << 20
MTU = 1500


class SlowLink:
    """Runs until the end of a `with` block; `figures` are what it said then. near: the prefix of
    commands that run in the namespace of the near end; far: a process in that of the far end.
    delay_s: one way. loss: share of the packets of each direction."""

    def __init__(self, near, far, name, addresses, delay_s, loss, seed=1):
        self.figures = None
        self._process = subprocess.Popen(
            [*near, sys.executable, __file__, str(far), "--name", name, "--near", addresses[0],
             "--far", addresses[1], "--delay-ms", str(1e3 * delay_s), "--loss", str(loss), "--seed",
             str(seed)], stdout=subprocess.PIPE, text=True)
        if self._process.stdout.readline() != "ready\n":
            self._process.kill()
            raise RuntimeError("no slow link")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.terminate()
        said = self._process.stdout.read()
        require_an_end(self._process, 10)
        self._process.stdout.close()
        self.figures = json.loads(said) if said else None


class Direction:
    """Packets from one device to the other."""

    def __init__(self, source, sink, options, seed):
        self.source, self._sink = source, sink
        self._delay_ns, self._loss = int(1e6 * options.delay_ms), options.loss
        self._random = random.Random(seed).random
        self._queue, self._queued = collections.deque(), 0
        self.figures = {"packets": 0, "bytes": 0, "lost": 0, "overflowed": 0}

    def take(self):
        """What is there now, at most so much that the other direction waits for no longer than a
        few hundred microseconds."""
        due = time.monotonic_ns() + self._delay_ns
        for _ in range(32):
            try:
                packet = os.read(self.source, 65536)
            except BlockingIOError:
                return
            self.figures["packets"] += 1
            self.figures["bytes"] += len(packet)
            if self._random() < self._loss:
                self.figures["lost"] += 1
            elif self._queued + len(packet) > QUEUE_BYTES:
                self.figures["overflowed"] += 1
            else:
                self._queue.append((due, packet))
                self._queued += len(packet)

    def give(self):
        """What has arrived; returns when the next does, none: nothing is under way."""
        now = time.monotonic_ns()
        while self._queue and self._queue[0][0] <= now:
            _, packet = self._queue.popleft()
            self._queued -= len(packet)
            try:
                os.write(self._sink, packet)
            except OSError:  # the device is going, or has no room
                self.figures["overflowed"] += 1
        return self._queue[0][0] if self._queue else None


def enter(namespace):
    if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), "setns")


def open_device(name, address):
    """In the namespace of this thread."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TUN | IFF_NO_PI))
    for command in (["address", "add", address, "dev", name],
                    ["link", "set", name, "mtu", str(MTU), "txqueuelen", "5000", "up"]):
        subprocess.run(["ip", *command], check=True)
    return device


def run(options):
    with open("/proc/self/ns/net", "rb") as here, open(f"/proc/{options.pid}/ns/net", "rb") as there:
        near = open_device(options.name, options.near)
        enter(there)
        far = open_device(options.name, options.far)
        enter(here)
    ways = [Direction(near, far, options, 2 * options.seed),
            Direction(far, near, options, 2 * options.seed + 1)]
    is_over = []
    signal.signal(signal.SIGTERM, lambda *_: is_over.append(True))
    print("ready", flush=True)
    while not is_over:
        dues = [due for due in [way.give() for way in ways] if due is not None]
        # A signal is noticed within a second.
        wait_s = max(0.0, (min(dues) - time.monotonic_ns()) / 1e9) if dues else 1.0
        ready, _, _ = select.select([near, far], [], [], wait_s)
        for way in ways:
            if way.source in ready:
                way.take()
    print(json.dumps({"there": ways[0].figures, "back": ways[1].figures}), flush=True)


def main():
    parser = argparse.ArgumentParser(description="A cable that delays and drops packets.")
    parser.add_argument("pid", type=int, help="a process in the far namespace")
    parser.add_argument("--name", default="link", help="of both devices")
    parser.add_argument("--near", required=True, metavar="ADDRESS/BITS")
    parser.add_argument("--far", required=True, metavar="ADDRESS/BITS")
    parser.add_argument("--delay-ms", type=float, default=40.0, help="one way")
    parser.add_argument("--loss", type=float, default=0.01, help="share, of each direction")
    parser.add_argument("--seed", type=int, default=1)
    run(parser.parse_args())


if __name__ == "__main__":
    main()
