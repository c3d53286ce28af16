"""What loads a daemon: workers that call, and readers of voxels."""

import threading
import time

import crash
from palpate.v1 import volume_stream_pb2
from support import PATIENCE_S, StreamReader


class Worker:
    """Calls one thing at a rate, on a thread, until it is stopped or fails."""

    def __init__(self, name, rate_hz, call):
        self.name, self.calls, self.error = name, 0, None
        self._period_s, self._call = 1.0 / rate_hz, call
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        next_s = time.monotonic()
        while not self._stop.is_set():
            try:
                self._call()
                self.calls += 1
            except Exception as error:  # whatever it is, it is the result
                self.error = error
                return
            next_s = max(next_s + self._period_s, time.monotonic() - 0.2)
            self._stop.wait(max(0.0, next_s - time.monotonic()))

    def stop(self):
        self._stop.set()
        self._thread.join(PATIENCE_S)


class VolumeReader(StreamReader):
    """Of the voxels; `stands`: reads a few messages, then none."""

    def __init__(self, client, stands=False):
        self._stands = stands
        start = volume_stream_pb2.StreamVolumeRequest()
        start.start.SetInParent()
        super().__init__(client.volume.StreamVolume, start)

    def take(self, message):
        return not self._stands or self.messages <= 3


def verdict(daemon, found):
    """Ends the daemon, and prints what was found wrong: the script's exit status."""
    status = daemon.end()
    if status:
        found.append(f"palpated ended with {status}: {''.join(daemon.said[-5:])}")
    found += crash.found
    for line in found[:20]:
        print(f"FAILED: {line}")
    return 1 if found else 0


def faults(workers, readers):
    """What was wrong with them, in words."""
    return [f"{w.name}: {w.error}" for w in workers if w.error] + [
        f"a stream: {r.error}" for r in readers if r.error]
