"""The led hand of the simulated device: to feel from a program, without a device."""

import atexit
import collections.abc
import queue
import threading
import time
import types
import typing

import grpc
import numpy as np
import numpy.typing as npt

from palpate._errors import InvalidArgument, error_of
from palpate._geometry import Triple, numbers_of, vector_of
from palpate._link import Link
from palpate._poses import Poses, PoseStream
from palpate._values import number, whole
from palpate.v1 import device_pb2

_SEND_PERIOD_S = 0.008
_MAX_BUTTONS = (1 << 32) - 1
_FELT_HZ = 1000.0
_FELT_BATCH = 20
# The path begins when the hand rests at its first point, or rests against what is in its way.
_REST_MM = 0.02
_REST_SAMPLES = 100
_MOST_WAY_S = 3.0
# The hand is behind the target by some 40 ms.
_LAST_S = 0.1


class _Targets:
    """What the hand is to do now. Any thread."""

    def __init__(self, target_mm: npt.NDArray[np.float64]) -> None:
        self._lock = threading.Lock()
        self._has_ended = threading.Event()
        self.set(np.zeros(1), target_mm.reshape(1, 3), 0)

    def set(self, times_s: npt.NDArray[np.float64], points_mm: npt.NDArray[np.float64],
            buttons: int) -> None:
        with self._lock:
            self._begin_s = time.monotonic()
            self._times_s, self._points_mm, self._buttons = times_s, points_mm, buttons

    def request(self) -> device_pb2.LeadHandRequest:
        with self._lock:
            now_s = time.monotonic() - self._begin_s
            at_mm = [np.interp(now_s, self._times_s, column) for column in self._points_mm.T]
            return device_pb2.LeadHandRequest(target_mm=vector_of("target_mm", at_mm),
                                              buttons=self._buttons)

    def end(self) -> None:
        self._has_ended.set()

    def __iter__(self) -> collections.abc.Iterator[device_pb2.LeadHandRequest]:
        """gRPC reads the requests on a thread of its own."""
        while not self._has_ended.is_set():
            yield self.request()
            self._has_ended.wait(_SEND_PERIOD_S)


class Hand:
    """The simulated hand while this program leads it; Device.lead makes one.

    The hand goes to the newest target, as far as the surface lets it: 0.3 N pull it 1 mm away from
    the target. In free space it is some 40 ms behind. The hand explores by itself again when the
    `with` block or the program ends.
    Errors, in every method: Conflict (somebody else leads the hand), FailedPrecondition (the device
    is not the simulated one), PermissionDenied, Unavailable.
    Example: with conn.device.lead() as hand: hand.move_to((0, 10, 0))
    """

    def __init__(self, link: Link, method: typing.Any, target_mm: Triple | None) -> None:
        self._link = link
        if target_mm is None:
            with PoseStream(link, 60.0, 1, 1) as stream:
                start_mm = next(stream).hip_mm[-1]
        else:
            start_mm = _point("target_mm", target_mm)
        self._targets = _Targets(start_mm)
        self._news: queue.SimpleQueue[grpc.RpcError | None] = queue.SimpleQueue()
        self._failed: grpc.RpcError | None = None
        self._is_open = True
        link.check_open()
        # Only this thread uses gRPC: Ctrl-C within gRPC would leave its locks held.
        self._thread = threading.Thread(target=self._run, args=(method,), name="palpate hand",
                                        daemon=True)
        _leading.add(self)
        self._thread.start()
        try:
            failed = self._news.get()
        except BaseException:
            self.close()
            raise
        if failed is not None:
            self.close()
            raise error_of(link.name, failed)

    def _run(self, method: typing.Any) -> None:
        try:
            for _ in method(iter(self._targets)):
                self._news.put(None)
        except grpc.RpcError as failed:
            self._failed = failed
            self._news.put(failed)
        except ValueError:
            pass  # the connection was closed
        finally:
            self._targets.end()
            self._news.put(None)
            _leading.discard(self)

    def move_to(self, target_mm: Triple, buttons: int = 0) -> None:
        """Sets the target. Does not wait for the hand.

        target_mm: (3,) in the device frame, mm; beyond the workspace the nearest place in it.
        buttons: bit n: the stylus's button n is pressed.
        Errors: InvalidArgument; see help(palpate.Hand). Example: hand.move_to((0, 10, 0))
        """
        self._lead(np.zeros(1), _point("target_mm", target_mm).reshape(1, 3), buttons)

    def follow(self, path_mm: npt.ArrayLike, rate_hz: float = 100.0, *,
               buttons: int = 0) -> Poses:
        """Leads the hand along a path and returns what it felt, at 1000 samples per second.

        The hand first goes straight to the first point. What it feels on that way is left out.
        path_mm: (n, 3) targets in the device frame, mm. Between two of them the target moves
        along a straight line.
        rate_hz: points per second, above 0. Any rate is smooth.
        buttons: bit n: the stylus's button n is pressed.
        Errors: InvalidArgument; see help(palpate.Hand).
        Example: felt = hand.follow(spiral_mm); plot(felt.hip_mm, felt.force_n)
        """
        points_mm = numbers_of("path_mm", path_mm)
        if points_mm.ndim != 2 or points_mm.shape[1] != 3 or len(points_mm) == 0:
            raise InvalidArgument(f"path_mm is an array (n, 3), not {points_mm.shape}")
        if not np.isfinite(points_mm).all():
            raise InvalidArgument("path_mm has numbers that are not finite")
        rate = number("rate_hz", rate_hz)
        if not 0 < rate < np.inf:
            raise InvalidArgument(f"rate_hz is above 0, not {rate:g}")
        times_s = np.arange(len(points_mm)) / rate
        self.move_to(points_mm[0], buttons)
        # Every sample, whatever pauses this program makes.
        with PoseStream(self._link, _FELT_HZ, _FELT_BATCH, 1 << 20) as stream:
            _wait_for_rest(stream)
            self._lead(times_s, points_mm, buttons)
            felt = [next(stream)]
            end_ns = felt[0].time_ns[0] + int(1e9 * (times_s[-1] + _LAST_S))
            while felt[-1].time_ns[-1] < end_ns:
                self._check()
                felt.append(next(stream))
        return Poses.concatenate(felt)

    def close(self) -> None:
        """Gives the hand back. Closing twice is no error. Example: hand.close()"""
        self._is_open = False
        self._targets.end()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _lead(self, times_s: npt.NDArray[np.float64], points_mm: npt.NDArray[np.float64],
              buttons: int) -> None:
        self._check()
        self._targets.set(times_s, points_mm, whole("buttons", buttons, 0, _MAX_BUTTONS))

    def _check(self) -> None:
        if not self._is_open:
            raise InvalidArgument("the hand was given back: lead it again with device.lead()")
        if self._failed is not None:
            raise error_of(self._link.name, self._failed)
        if not self._thread.is_alive():
            raise self._link.error_of_end(None)

    def __enter__(self) -> "Hand":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: types.TracebackType | None) -> None:
        self.close()


_leading: set[Hand] = set()


@atexit.register
def _end_all() -> None:
    # See _poses.py: no thread may be stopped within gRPC.
    for hand in list(_leading):
        hand.close()


def _point(name: str, value: Triple) -> npt.NDArray[np.float64]:
    point = numbers_of(name, value)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InvalidArgument(f"{name} is three finite numbers: x, y, z in mm")
    return point


def _wait_for_rest(stream: PoseStream) -> None:
    seen = [next(stream)]
    begin_ns = seen[0].time_ns[0]
    while seen[-1].time_ns[-1] - begin_ns < _MOST_WAY_S * 1e9:
        seen.append(next(stream))
        newest_mm = np.concatenate([poses.hip_mm for poses in seen])[-_REST_SAMPLES:]
        if len(newest_mm) == _REST_SAMPLES and (np.ptp(newest_mm, axis=0) < _REST_MM).all():
            return
