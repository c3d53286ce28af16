"""What loads a daemon: workers that call, and readers of voxels."""

import threading
import time

import grpc

from palpate.v1 import volume_stream_pb2
from support import PATIENCE_S


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


class VolumeReader:
    """Follows the voxels, acknowledging what comes; `stands`: reads a few messages, then none."""

    def __init__(self, client, stands=False):
        self.messages, self.error, self._stopped, self._stands = 0, None, False, stands
        self._take = threading.Semaphore(0)
        self._call = client.volume.StreamVolume(self._requests())
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _requests(self):
        start = volume_stream_pb2.StreamVolumeRequest()
        start.start.SetInParent()
        yield start
        while True:
            self._take.acquire()
            if self._stopped:
                return
            request = volume_stream_pb2.StreamVolumeRequest()
            request.acknowledgement.message_number = self.messages
            yield request

    def _read(self):
        try:
            for message in self._call:
                self.messages = message.message_number
                if self._stands and self.messages > 3:
                    return
                self._take.release()
        except grpc.RpcError as error:
            if not self._stopped:
                self.error = error

    def stop(self):
        self._stopped = True
        self._call.cancel()
        self._take.release()
        self._thread.join(PATIENCE_S)


def faults(workers, readers):
    """What was wrong with them, in words."""
    return [f"{w.name}: {w.error}" for w in workers if w.error] + [
        f"a stream: {r.error}" for r in readers if r.error]
