"""The led hand of the simulated device: to feel from a program, without a device."""

import atexit
import collections.abc
import dataclasses
import queue
import threading
import time
import types
import typing
import warnings

import grpc
import numpy as np
import numpy.typing as npt

from palpate._enums import ForceState
from palpate._errors import Conflict, Error, InvalidArgument, Unavailable
from palpate._geometry import (Quadruple, Triple, array_of_vector, numbers_of, quaternion_of,
                               vector_of)
from palpate._link import Link, forget_in_child
from palpate._poses import Poses, PoseStream
from palpate._values import number, whole
from palpate.v1 import device_pb2, device_pb2_grpc

_SEND_PERIOD_S = 0.008
_MAX_BUTTONS = (1 << 32) - 1
_FELT_HZ = 1000.0
_FELT_BATCH = 100
# The path begins when the hand rests at its first point, or rests against what is in its way.
_REST_MM = 0.02
_REST_SAMPLES = 100
_MOST_WAY_S = 3.0
_TURN_MM = 60.0  # a turn by an angle counts as 30 mm times it: half of it is in a quaternion
# A force moves the hand away from its target, as a spring does.
_SPRING_N_PER_MM = 0.3
_NEAR_MM = 0.5
# Longer than the hand is behind the target.
_LAST_S = 0.1
_FINISH_TIMEOUT_S = 1.0
# The daemon answers at the first tick that follows the target.
_TAKE_TIMEOUT_S = 10.0


class _Targets:
    """What the hand is to do now. Any thread."""

    def __init__(self, target_mm: npt.NDArray[np.float64]) -> None:
        self._lock = threading.Lock()
        self._has_ended = threading.Event()
        self.set(np.zeros(1), target_mm.reshape(1, 3), 0)

    def set(self, times_s: npt.NDArray[np.float64], points_mm: npt.NDArray[np.float64],
            buttons: int, turns: npt.NDArray[np.float64] | None = None) -> None:
        with self._lock:
            self._begin_s = time.monotonic()
            self._times_s, self._points_mm, self._buttons = times_s, points_mm, buttons
            self._turns = turns

    def request(self) -> device_pb2.LeadHandRequest:
        with self._lock:
            now_s = time.monotonic() - self._begin_s
            at_mm = np.array([np.interp(now_s, self._times_s, column)
                              for column in self._points_mm.T])
            request = device_pb2.LeadHandRequest(target_mm=vector_of("target_mm", at_mm),
                                                 buttons=self._buttons)
            if self._turns is not None:
                last = max(int(np.searchsorted(self._times_s, now_s, side="right")) - 1, 0)
                request.orientation.CopyFrom(quaternion_of("orientation", self._turns[last]))
            return request

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
    the target. In free space it is some 30 ms behind. The hand explores by itself again when the
    `with` block or the program ends.
    Errors, in every method: Conflict (somebody else leads the hand), FailedPrecondition (the device
    is not the simulated one), PermissionDenied, Unavailable.
    Example: with conn.device.lead() as hand: hand.move_to((0, 10, 0))
    """

    def __init__(self, link: Link, target_mm: Triple | None) -> None:
        self._link = link
        self._stub = link.stub(device_pb2_grpc.DeviceServiceStub)
        answer = self._answer()
        self._has_warned = False
        self._least_mm = array_of_vector(answer.device.workspace_min_mm)
        self._most_mm = array_of_vector(answer.device.workspace_max_mm)
        if target_mm is None:
            with PoseStream(link, 60.0, 1, 1) as stream:
                newest = next(stream)
                start_mm = newest.hip_mm[-1] - newest.force_n[-1] / _SPRING_N_PER_MM
        else:
            start_mm = self._reached("target_mm", _point("target_mm", target_mm))
        self._targets = _Targets(start_mm)
        self._call: typing.Any = None
        # Whether the hand was taken; then whether it is still led.
        self._news: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._failed: grpc.RpcError | None = None
        self._is_open = True
        link.check_open()
        # Only this thread leads: Ctrl-C within gRPC would leave its locks held.
        self._thread = threading.Thread(target=self._run, name="palpate hand", daemon=True)
        _leading.add(self)
        self._thread.start()
        try:
            is_taken = self._news.get(timeout=_TAKE_TIMEOUT_S)
        except queue.Empty:
            self.close()
            raise Unavailable(f"palpated at {link.name} did not take the hand: its haptic loop "
                              "does not tick; look at its log, or start it again") from None
        except BaseException:
            self.close()
            raise
        if not is_taken:
            self.close()
            raise self._error_of_end()
        if answer.forces.state not in (ForceState.ON, ForceState.RAMP_IN):
            warnings.warn(f"forces are {ForceState(answer.forces.state)}: the hand feels 0 N until "
                          "device.enable()", stacklevel=3)

    def _run(self) -> None:
        try:
            self._call = self._stub.LeadHand(iter(self._targets))
            for _ in self._call:
                self._news.put(True)
        except grpc.RpcError as failed:
            self._failed = failed
        except ValueError:
            pass  # the connection was closed
        finally:
            self._call = None  # as in AcknowledgedCall
            self._targets.end()
            self._news.put(False)
            _leading.discard(self)

    def move_to(self, target_mm: Triple, buttons: int = 0, *,
                orientation: Quadruple | None = None) -> None:
        """Sets the target. Does not wait for the hand.

        target_mm: (3,) in the device frame, mm; beyond the workspace the nearest place in it, with
        a UserWarning.
        buttons: bit n: the stylus's button n is pressed.
        orientation: (4,) how the stylus is to be turned: a unit quaternion w, x, y, z, from its axes
        to the device's; None: as it turns by itself.
        Errors: InvalidArgument; see help(palpate.Hand). Example: hand.move_to((0, 10, 0))
        """
        target = self._reached("target_mm", _point("target_mm", target_mm))
        turns = None if orientation is None else _turns("orientation", np.array([orientation]), 1)
        self._lead(np.zeros(1), target.reshape(1, 3), buttons, turns)

    def follow(self, path_mm: npt.ArrayLike, rate_hz: float = 100.0, *,
               buttons: int = 0, orientations: npt.ArrayLike | None = None) -> Poses:
        """Leads the hand along a path and returns what it felt, at 1000 samples per second.

        The hand first goes straight to the first point. The path begins when the hand rests there,
        or against what is in its way, and after 3 s in any case. What it feels before is left out.
        path_mm: (n, 3) targets in the device frame, mm; beyond the workspace as in move_to.
        Between two of them the target moves along a straight line.
        rate_hz: points per second, above 0. Any rate is smooth.
        buttons: bit n: the stylus's button n is pressed.
        orientations: (n, 4) one for each point, as orientation in move_to; None: as it turns by
        itself.
        Errors: InvalidArgument; see help(palpate.Hand).
        Example: felt = hand.follow(spiral_mm); plot(felt.hip_mm, felt.force_n)
        """
        points_mm = numbers_of("path_mm", path_mm)
        if points_mm.ndim != 2 or points_mm.shape[1] != 3 or len(points_mm) == 0:
            raise InvalidArgument(f"path_mm is an array (n, 3), not {points_mm.shape}")
        if not np.isfinite(points_mm).all():
            raise InvalidArgument("path_mm has numbers that are not finite")
        points_mm = self._reached("path_mm", points_mm)
        rate = number("rate_hz", rate_hz)
        if not 0 < rate < np.inf:
            raise InvalidArgument(f"rate_hz is above 0, not {rate:g}")
        times_s = np.arange(len(points_mm)) / rate
        turns = (None if orientations is None
                 else _turns("orientations", orientations, len(points_mm)))
        self._lead(np.zeros(1), points_mm[:1], buttons, turns)
        # Every sample, whatever pauses this program makes.
        with PoseStream(self._link, _FELT_HZ, _FELT_BATCH, 1 << 20) as stream:
            _wait_for_rest(stream, points_mm[0], None if turns is None else turns[0])
            # The stream may be behind. What belongs to the path, the daemon's ticks say.
            first_tick = self._ticks()
            self._lead(times_s, points_mm, buttons, turns)
            end_s = time.monotonic() + times_s[-1] + _LAST_S
            felt: list[Poses] = []
            while time.monotonic() < end_s:
                self._check()
                felt.append(next(stream))
            last_tick = self._ticks()
            while not felt or felt[-1].tick[-1] < last_tick:
                self._check()
                felt.append(next(stream))
        return _since(first_tick, Poses.concatenate(felt))

    def close(self) -> None:
        """Gives the hand back. Closing twice is no error. Example: hand.close()"""
        self._is_open = False
        self._targets.end()
        if threading.current_thread() is self._thread:
            return
        self._thread.join(_FINISH_TIMEOUT_S)
        if self._thread.is_alive() and (call := self._call) is not None:
            # The daemon does not answer. On another thread: see _poses.py.
            threading.Thread(target=call.cancel, daemon=True).start()
            self._thread.join()

    def _lead(self, times_s: npt.NDArray[np.float64], points_mm: npt.NDArray[np.float64],
              buttons: int, turns: npt.NDArray[np.float64] | None) -> None:
        self._check()
        self._targets.set(times_s, points_mm, whole("buttons", buttons, 0, _MAX_BUTTONS), turns)

    def _check(self) -> None:
        if not self._is_open:
            raise InvalidArgument("the hand was given back: lead it again with device.lead()")
        if self._failed is not None or not self._thread.is_alive():
            raise self._error_of_end()

    def _error_of_end(self) -> Error:
        failed = self._failed
        if failed is not None and failed.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
            # The daemon has waited, not this program.
            return Unavailable(f"palpated at {self._link.name} took the hand back: "
                               f"{failed.details()}")
        if failed is not None and failed.code() == grpc.StatusCode.ABORTED and any(
                hand._link.name == self._link.name for hand in list(_leading) if hand is not self):
            return Conflict("this program leads the hand already: close that hand first, or use "
                            "`with`")
        return self._link.error_of_end(failed)

    def _answer(self) -> device_pb2.GetDeviceResponse:
        answer: device_pb2.GetDeviceResponse = self._link.call(self._stub.GetDevice,
                                                               device_pb2.GetDeviceRequest())
        return answer

    def _ticks(self) -> int:
        """Returns how many ticks the daemon has executed."""
        return int(self._answer().servo.ticks)

    def _reached(self, name: str, points_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Returns the places that the hand can reach. Warns the first time that they are others."""
        reached_mm = np.clip(points_mm, self._least_mm, self._most_mm)
        beyond_mm = float(np.abs(reached_mm - points_mm).max())
        if beyond_mm > 0 and not self._has_warned:
            self._has_warned = True
            warnings.warn(f"{name} lies up to {beyond_mm:.3g} mm beyond the workspace "
                          f"{self._least_mm} to {self._most_mm} mm: the hand stays in it",
                          stacklevel=3)
        return reached_mm

    def __enter__(self) -> "Hand":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: types.TracebackType | None) -> None:
        self.close()


_leading: set[Hand] = set()
forget_in_child(_leading)


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


def _turns(name: str, values: npt.ArrayLike, count: int) -> npt.NDArray[np.float64]:
    turns = numbers_of(name, values)
    if turns.shape != (count, 4) or not np.allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-3):
        raise InvalidArgument(f"{name} has unit quaternions w, x, y, z, one for each point")
    return turns


def _since(tick: int, poses: Poses) -> Poses:
    is_kept = poses.tick >= tick
    values = {field.name: getattr(poses, field.name) for field in dataclasses.fields(poses)}
    return Poses(**{name: value[is_kept] if isinstance(value, np.ndarray) else value
                    for name, value in values.items()})


def _wait_for_rest(stream: PoseStream, target_mm: npt.NDArray[np.float64],
                   turn: npt.NDArray[np.float64] | None) -> None:
    """Waits for at most _MOST_WAY_S. The hand may still rest at the place where it was before."""
    def where(poses: Poses) -> npt.NDArray[np.float64]:
        if turn is None:
            return poses.hip_mm
        turned = poses.stylus_orientation
        return np.hstack([poses.hip_mm, _TURN_MM * np.sign(turned @ turn)[:, None] * turned])

    newest = next(stream)
    places = where(newest)
    begin, has_moved = places[0], False
    end_s = time.monotonic() + _MOST_WAY_S
    while time.monotonic() < end_s:
        newest = next(stream)
        places = np.concatenate([places, where(newest)])[-_REST_SAMPLES:]
        has_moved = has_moved or _is_far(places[-1], begin)
        rests = len(places) == _REST_SAMPLES and (np.ptp(places, axis=0) < _REST_MM).all()
        expected = target_mm + newest.force_n[-1] / _SPRING_N_PER_MM
        if turn is not None:
            expected = np.r_[expected, _TURN_MM * turn]
        if rests and (has_moved or not _is_far(places[-1], expected)):
            return


def _is_far(a_mm: npt.NDArray[np.float64], b_mm: npt.NDArray[np.float64]) -> bool:
    return bool(np.linalg.norm(a_mm - b_mm) > _NEAR_MM)
