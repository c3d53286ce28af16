"""The stream of ticks as batches of NumPy arrays."""

import atexit
import collections
import collections.abc
import dataclasses
import operator
import queue
import threading
import time
import types
import typing

import grpc
import numpy as np
import numpy.typing as npt

from palpate._errors import InvalidArgument, Unavailable
from palpate._link import AcknowledgedCall, Link, forget_in_child
from palpate._pose_columns import ABOUT, SOURCES, PoseColumns
from palpate._tables import Table
from palpate._values import number, whole
from palpate.v1 import pose_pb2, pose_pb2_grpc

_MAX_UNACKNOWLEDGED = 4
# As in palpate/v1/pose.proto.
_MAX_RATE_HZ = 1000
_MAX_BATCH = 256
_MAX_WAITING = 1 << 31
_SILENCE_S = 0.5
_PATIENCE_S = 5.0
_FINISH_TIMEOUT_S = 1.0


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Poses(PoseColumns, Table):
    __doc__ = f"""n samples of the servo's ticks, oldest first; len() is n.

    Positions, normals and forces are in the device frame: x right, y up, z towards the
    user. Units are in the names; density and isovalue are in data units. A value that a tick
    does not have is NaN.

{ABOUT}    sent_time_ns: time_ns of the daemon when it sent the newest sample, ns
    dropped_samples: samples that this stream has lost so far because it was not read fast
        enough
    """

    sent_time_ns: int
    dropped_samples: int

    def __len__(self) -> int:
        return len(self.tick)

    def __repr__(self) -> str:
        # Without the arrays, which would fill the screen.
        ticks = f", ticks {self.tick[0]} to {self.tick[-1]}" if len(self) else ""
        return f"<palpate poses: {len(self)} samples{ticks}, {self.dropped_samples} dropped>"

    @staticmethod
    def concatenate(batches: collections.abc.Sequence["Poses"]) -> "Poses":
        """Joins at least one batch into one, in the order given.

        batches: a list of Poses. dropped_samples is that of the last one.
        Errors: InvalidArgument (no batch).
        Example: poses = palpate.Poses.concatenate([next(stream) for _ in range(20)])
        """
        if not len(batches):
            raise InvalidArgument("there is no batch to join: give at least one")
        joined: dict[str, typing.Any] = {}
        for field in dataclasses.fields(Poses):
            parts = [getattr(batch, field.name) for batch in batches]
            joined[field.name] = parts[-1] if isinstance(parts[0], int) else np.concatenate(parts)
        return Poses(**joined)


def _column(samples: collections.abc.Sequence[pose_pb2.PoseSample], path: str,
            kind: type | str) -> npt.NDArray[typing.Any]:
    get = operator.attrgetter(path)
    if not isinstance(kind, str):
        return np.array([get(sample) for sample in samples], dtype=kind)
    parts, absent = operator.attrgetter(*kind), (np.nan,) * len(kind)
    rows = [parts(get(sample)) if sample.HasField(path) else absent for sample in samples]
    return np.array(rows, dtype=np.float64).reshape(-1, len(kind))


def poses_of(message: pose_pb2.StreamPosesResponse, dropped_samples: int) -> Poses:
    """Makes Poses of a message. dropped_samples counts losses at the daemon and in this client."""
    columns: dict[str, typing.Any] = {name: _column(message.samples, path, kind)
                                      for name, (path, kind) in SOURCES.items()}
    return Poses(**columns, sent_time_ns=message.sent_time_ns, dropped_samples=dropped_samples)


class _Receiver:
    """A thread that takes the messages of a call. If too many wait, it drops the oldest.

    Only this thread uses gRPC. Ctrl-C interrupts the main thread between any two steps; within
    gRPC, locks would stay held. For the same reason the two threads share no Python lock.
    """

    def __init__(self, call: AcknowledgedCall, waiting: int) -> None:
        self._call = call
        self._messages: collections.deque[pose_pb2.StreamPosesResponse] = collections.deque(
            maxlen=waiting)
        self._failed: grpc.RpcError | None = None
        self._has_ended = False
        # When the newest message came, and whether it is of a replay.
        self._newest: tuple[float, bool] | None = None
        # Not empty: there may be a message, or the end.
        self._news: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._receive, name="palpate poses", daemon=True)
        _receivers.add(self)
        self._thread.start()

    def _receive(self) -> None:
        try:
            for message in self._call:
                self._messages.append(message)
                self._newest = (time.monotonic(), message.samples[-1].replayed)
                self._wake()
        except grpc.RpcError as failed:
            self._failed = failed
        except ValueError:
            # The connection was closed before the call began.
            pass
        finally:
            self._has_ended = True
            self._wake()
            _receivers.discard(self)

    def _wake(self) -> None:
        if self._news.empty():
            self._news.put(None)

    def take(self, timeout_s: float) -> pose_pb2.StreamPosesResponse | None:
        """Waits for the oldest waiting message and returns it; None at the end.

        Errors: queue.Empty (none within the timeout).
        """
        end_s = time.monotonic() + timeout_s
        while True:
            # Read before looking for messages: no message comes after the end.
            has_ended = self._has_ended
            if self._messages:
                return self._messages.popleft()
            if has_ended:
                return None
            self._news.get(timeout=max(0.0, end_s - time.monotonic()))

    def shows(self, silence_s: float) -> typing.Literal["live", "old", "replay"]:
        newest = self._newest
        if newest is None or self._has_ended or time.monotonic() - newest[0] > silence_s:
            return "old"
        return "replay" if newest[1] else "live"

    @property
    def failed(self) -> grpc.RpcError | None:
        """Why the call ended; None: the daemon ended it without an error."""
        return self._failed

    def finish(self) -> None:
        """Ends the call; the thread then ends, too. Does not wait."""
        self._call.finish()

    def close(self) -> None:
        """Ends call and thread, also if the daemon does not answer."""
        self._call.finish()
        self._join(_FINISH_TIMEOUT_S)
        if self._thread.is_alive():
            threading.Thread(target=self._call.cancel, daemon=True).start()
            self._join(None)

    def _join(self, timeout_s: float | None) -> None:
        if self._thread.ident is not None and threading.current_thread() is not self._thread:
            self._thread.join(timeout_s)


# All running threads, also those whose stream was already released. A forked child has none.
_receivers: set[_Receiver] = set()
forget_in_child(_receivers)


@atexit.register
def _end_all() -> None:
    # A thread that the interpreter's end stops within gRPC keeps gRPC's locks, and the end then
    # waits for these locks forever. Ctrl-C can leave such a thread behind at any point.
    for receiver in list(_receivers):
        receiver.close()


class PoseStream:
    """Iterates over batches of poses until it is closed; Connection.poses makes one.

    It ends with a `with` block, with close(), with the last reference to it, and with an
    exception within next(), such as the KeyboardInterrupt of Ctrl-C. Iterate on one thread;
    call close() on any.
    Errors, in the iteration: see help(palpate.Connection.poses).
    Example: with conn.poses() as stream: print(next(stream).hip_mm)
    """

    def __init__(self, link: Link, rate_hz: float, batch: int, waiting: int) -> None:
        rate = number("rate_hz", rate_hz)
        if not 0 < rate <= _MAX_RATE_HZ:
            raise InvalidArgument(f"rate_hz is above 0 to {_MAX_RATE_HZ}, not {rate:g}")
        waiting = whole("waiting", waiting, 1, _MAX_WAITING)
        start = pose_pb2.StreamPosesStart(rate_hz=rate, batch=whole("batch", batch, 1, _MAX_BATCH),
                                          max_unacknowledged=_MAX_UNACKNOWLEDGED)
        if waiting > 1:
            # While the interpreter is held, no thread of this program takes messages.
            start.waiting = min(waiting * start.batch, _MAX_WAITING)
        link.check_open()
        self._link = link
        self._silence_s = _SILENCE_S + 2 * start.batch / rate
        self._patience_s = _PATIENCE_S + 2 * start.batch / rate
        self._is_open = True
        self._taken = 0
        self._left_out = 0
        stub = link.stub(pose_pb2_grpc.PoseServiceStub)
        call = AcknowledgedCall(stub.StreamPoses, pose_pb2.StreamPosesRequest(start=start))
        # A separate object: the thread must not keep this object alive.
        self._receiver = _Receiver(call, waiting)

    def __iter__(self) -> "PoseStream":
        return self

    def __next__(self) -> Poses:
        """Waits for the next batch. Errors: see help(palpate.Connection.poses)."""
        if not self._is_open:
            raise StopIteration
        self._link.check_process()
        try:
            message = self._receiver.take(self._patience_s)
            if message is not None:
                # All messages of a stream have the same number of samples.
                self._left_out += (message.message_number - self._taken - 1) * len(message.samples)
                self._taken = message.message_number
                return poses_of(message, message.dropped_samples + self._left_out)
        except queue.Empty:
            self.close()
            raise Unavailable(f"no sample came from palpated at {self._link.name} for "
                              f"{self._patience_s:.0f} s: its haptic loop stands still, or the "
                              "network is gone; look at its log") from None
        except BaseException:
            self.close()
            raise
        if not self._is_open:
            raise StopIteration
        raise self._link.error_of_end(self._receiver.failed)

    @property
    def shows(self) -> typing.Literal["live", "old", "replay"]:
        """What the newest sample is; also samples that next() has not returned yet count.

        "live": of now. "replay": of a recording that somebody replays: forces are off;
        conn.recording.state().replay says who replays what. "old": nothing comes from the daemon.
        Any thread. Example: print(stream.shows)
        """
        return self._receiver.shows(self._silence_s)

    def close(self) -> None:
        """Ends the stream, its thread, and an iteration over it. Closing twice is no error.

        Example: stream.close()
        """
        self._is_open = False
        self._receiver.close()

    def __enter__(self) -> "PoseStream":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: types.TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        # Without waiting: this may be any thread. If __init__ failed, there is no receiver.
        if hasattr(self, "_receiver"):
            self._receiver.finish()
