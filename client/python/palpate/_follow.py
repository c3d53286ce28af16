"""A copy of the volume that stays equal to the daemon's."""

import atexit
import collections.abc
import contextlib
import dataclasses
import queue
import threading
import time
import types
import typing

import numpy as np
import numpy.typing as npt

from palpate._errors import Error, Internal, InvalidArgument, TooLarge, Unavailable
from palpate._geometry import matrix_of_map
from palpate._link import AcknowledgedCall, Link
from palpate._values import number_or_none, whole
from palpate._volume_copy import (Bricks, Volume, VolumeCopy, making_sense, messages_of,
                                  volume_call)
from palpate.v1 import volume_stream_pb2

_FINISH_TIMEOUT_S = 1.0
_CANCEL_TIMEOUT_S = 10.0
# Pause between attempts to resume.
_RETRY_S = 0.2


class _Follower:
    """The thread that follows the stream, and its copy of the volume.

    Bricks wait for the next `complete` and are then put into the copy together. So under the
    lock the copy always has one revision.
    """

    def __init__(self, link: Link, stub: typing.Any) -> None:
        link.check_open()
        self._link, self._stub = link, stub
        # Locked directly, not through `changed`: after Ctrl-C between two steps of Python's
        # Condition, the lock would stay held.
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        # Guarded by the lock: everything that other threads see.
        self.volume: Volume | None = None
        self.lost: Error | None = None
        self.ended: Error | None = None
        # Used by this thread only.
        self._copy: VolumeCopy | None = None
        self._waiting: list[Bricks] = []
        self._shown: VolumeCopy | None = None
        self._device_from_index: npt.NDArray[np.float64] | None = None
        self._resume_from: volume_stream_pb2.VolumeRevision | None = None
        self._is_open = True
        # Not empty: the thread must end. Not an Event, because the garbage collector may call
        # finish() while this thread holds the Event's lock.
        self._end: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._call: AcknowledgedCall | None = None
        self._thread = threading.Thread(target=self._run, name="palpate volume", daemon=True)
        _followers.add(self)
        self._thread.start()

    def _run(self) -> None:
        try:
            while self._is_open:
                try:
                    self._follow()
                except (Unavailable, Internal) as lost:
                    self._lose(lost)
                with contextlib.suppress(queue.Empty):
                    self._end.get(timeout=_RETRY_S)
            ended: Error = Unavailable("the live copy was closed")
        except Error as refused:
            ended = refused
        except MemoryError:
            ended = Internal("there is no memory for a copy of the volume")
        with self.lock:
            self.ended = ended
            self.changed.notify_all()
        _followers.discard(self)

    def _follow(self) -> None:
        """Runs until the stream ends."""
        call = self._call = volume_call(self._stub, self._resume_from)
        if not self._is_open:
            return
        with contextlib.closing(self._messages(call)) as messages:
            for message in messages:
                if not self._is_open:
                    return
                with making_sense():
                    self._take(message)

    def _messages(self, call: AcknowledgedCall) -> collections.abc.Generator[
            volume_stream_pb2.StreamVolumeResponse, None, None]:
        try:
            with contextlib.closing(messages_of(self._link, call)) as messages:
                yield from messages
        except TooLarge as full:
            # A limit of the daemon. Others may end their streams.
            raise Unavailable(str(full)) from None

    def _lose(self, lost: Error) -> None:
        self._link.check_open()
        if isinstance(lost, Internal):
            # The received data cannot be continued.
            self._copy = self._resume_from = None
        with self.lock:
            self.lost = lost
            self.changed.notify_all()

    def _take(self, message: volume_stream_pb2.StreamVolumeResponse) -> None:
        if self.lost is not None:
            with self.lock:
                self.lost = None
        event = message.WhichOneof("event")
        if event == "lattice":
            # The old volume stays visible until the new one is complete.
            self._copy, self._waiting = VolumeCopy(message.lattice), []
            self._device_from_index = self._resume_from = None
        elif event == "placement":
            self._place(matrix_of_map(message.placement.device_from_index))
        elif self._copy is None:
            raise ValueError("bricks before the lattice")
        elif event == "bricks":
            bricks = self._copy.bricks_of(message.bricks)
            if self._copy is self._shown:
                self._waiting.append(bricks)
            else:
                self._copy.put(bricks)
        elif event == "complete":
            self._complete(self._copy, message.complete)

    def _place(self, device_from_index: npt.NDArray[np.float64]) -> None:
        self._device_from_index = device_from_index
        if self._copy is self._shown and self.volume is not None:
            with self.lock:
                self.volume = dataclasses.replace(self.volume, device_from_index=device_from_index)

    def _complete(self, copy: VolumeCopy, complete: volume_stream_pb2.VolumeComplete) -> None:
        copy.check(complete)
        if self._device_from_index is None:
            raise ValueError("no placement")
        with self.lock:
            for bricks in self._waiting:
                copy.put(bricks)
            self.volume = copy.volume(copy.view(), complete.revision.volume_revision,
                                      self._device_from_index)
            self.changed.notify_all()
        self._shown, self._waiting = copy, []
        self._resume_from = complete.revision

    def finish(self) -> None:
        """Ends the stream; the thread then ends, too. Does not wait."""
        self._is_open = False
        self._end.put(None)
        if (call := self._call) is not None:
            call.finish()

    def close(self) -> None:
        """Ends stream and thread, also if the daemon does not answer."""
        self.finish()
        self._join(_FINISH_TIMEOUT_S)
        if self._thread.is_alive() and (call := self._call) is not None:
            threading.Thread(target=call.cancel, daemon=True).start()
            self._join(_CANCEL_TIMEOUT_S)

    def _join(self, timeout_s: float) -> None:
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout_s)


# All running threads, also those whose copy was already released.
_followers: set[_Follower] = set()


@atexit.register
def _end_all() -> None:
    # As in _poses.py: a thread that the interpreter's end stops within gRPC keeps gRPC's locks.
    for follower in list(_followers):
        follower.close()


class LiveVolume:
    """A copy of the volume that stays equal to the daemon's; VolumeAccess.follow() makes one.

    A thread of its own takes what the daemon sends. It changes the copy from one revision to a
    later one in one step, under a lock. If changes are fast, it may skip revisions.

    - `values` is quick: a read-only view of the copy. It changes while you read it.
    - held() keeps the copy still for a `with` block. Keep such a block short.
    - snapshot() copies all voxels. The result never changes.

    If the daemon goes away, the copy stays as it was, `lost` says why, and the thread tries to
    resume until it is closed. After resuming, the daemon sends only what has changed. After a
    restart of the daemon, or for another volume, the daemon sends all voxels. The new volume
    appears when it is complete.

    Any thread. A `with` block closes it, and so does the end of the last reference.
    Example: with conn.volume.follow() as live: print(live.snapshot().values.max())
    """

    def __init__(self, link: Link, stub: typing.Any) -> None:
        # A separate object: the thread must not keep this object alive.
        self._follower = _Follower(link, stub)

    @property
    def values(self) -> npt.NDArray[np.float32]:
        """(nx, ny, nz), indexed [x, y, z], data units. Read-only; it changes, see LiveVolume.

        Another volume has another array. Waits for the first copy. Errors: as wait().
        """
        return self._now().values

    @property
    def volume_revision(self) -> int:
        """The revision of the daemon's volume that the copy equals. Waits for the first copy.

        VolumeInfo.volume_revision has the same numbers. Errors: as wait().
        """
        return self._now().volume_revision

    @property
    def lost(self) -> Error | None:
        """Why the daemon cannot be followed now; None: no problem is known.

        When this becomes None again after a loss, the copy is still the old one. Use wait() for
        the new one.
        """
        with self._follower.lock:
            return self._follower.ended or self._follower.lost

    def snapshot(self) -> Volume:
        """Copies the volume, of one revision. Waits for the first copy. Errors: as wait().

        Example: values = live.snapshot().values
        """
        with self.held() as volume:
            return dataclasses.replace(volume, values=np.array(volume.values, order="C"))

    @contextlib.contextmanager
    def held(self) -> collections.abc.Iterator[Volume]:
        """Returns the volume and keeps it unchanged for a `with` block, without copying voxels.

        The array is read-only. After the block it changes again. Errors: as wait().
        Example: with live.held() as volume: print(volume.values.max())
        """
        self.wait()
        with self._follower.lock:
            volume = self._follower.volume
            assert volume is not None
            yield volume

    def wait(self, volume_revision: int = 0, timeout_s: float | None = None) -> int:
        """Waits until the copy has this revision or a later one. Returns the copy's revision.

        volume_revision: such as EditResult.volume_revision; 0: any. timeout_s: in seconds; None:
        no limit, also while the daemon is away.
        Errors: InvalidArgument, Unavailable (closed, or not within timeout_s), PermissionDenied,
        TooLarge (more than 2³¹ voxels).
        Example: live.wait(conn.edit.undo().volume_revision, timeout_s=10)
        """
        follower = self._follower
        volume_revision = whole("volume_revision", volume_revision)
        timeout_s = number_or_none("timeout_s", timeout_s)
        if timeout_s is not None and not timeout_s >= 0:
            raise InvalidArgument(f"timeout_s is at least 0, not {timeout_s:g}")
        end = None if timeout_s is None else time.monotonic() + timeout_s
        with follower.lock:
            while follower.volume is None or follower.volume.volume_revision < volume_revision:
                if follower.ended is not None:
                    raise follower.ended
                left = None if end is None else end - time.monotonic()
                if left is not None and left <= 0:
                    why = f": {follower.lost}" if follower.lost else ""
                    raise Unavailable(f"the copy did not reach the revision {volume_revision} "
                                      f"within {timeout_s:g} s{why}")
                follower.changed.wait(left)
            return follower.volume.volume_revision

    def _now(self) -> Volume:
        self.wait()
        volume = self._follower.volume
        assert volume is not None
        return volume

    def close(self) -> None:
        """Ends following. The copy stays. Closing twice is no error. Example: live.close()"""
        self._follower.close()

    def __enter__(self) -> "LiveVolume":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: types.TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        # Without waiting: this may be any thread. If __init__ failed, there is no follower.
        if hasattr(self, "_follower"):
            self._follower.finish()

    def __repr__(self) -> str:
        volume = self._follower.volume
        if volume is None:
            return "<palpate live volume: nothing has come yet>"
        lost = f", lost: {self.lost}" if self.lost else ""
        return (f"<palpate live volume: {volume.source}, {volume.values.shape}, revision "
                f"{volume.volume_revision}{lost}>")
