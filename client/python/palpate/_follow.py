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
from palpate._link import AcknowledgedCall, Link, forget_in_child
from palpate._values import number_or_none, whole
from palpate._volume_copy import VolumeCopy, making_sense, messages_of, place_of, volume_call
from palpate._voxels import Volume, Voxels
from palpate.v1 import volume_stream_pb2

_FINISH_TIMEOUT_S = 1.0
_CANCEL_TIMEOUT_S = 10.0
# Pause between attempts to resume.
_RETRY_S = 0.2


class _Follower:
    """The thread that follows the stream, and the volume of its last `complete`.

    That volume never changes. Bricks of the next revision go into a copy, which shares with the
    volume what has stayed.
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
        # The copy that `volume` is of.
        self._shown: VolumeCopy | None = None
        self._placement: volume_stream_pb2.VolumePlacement | None = None
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
        if self._copy is not None:
            # The daemon sends everything after the revision to resume from.
            self._copy.go_back()
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
            self._copy = VolumeCopy(message.lattice)
            self._placement = self._resume_from = None
        elif event == "placement":
            self._place(message.placement)
        elif self._copy is None:
            raise ValueError("bricks before the lattice")
        elif event == "bricks":
            self._copy.take(message.bricks)
        elif event == "complete":
            self._complete(self._copy, message.complete)

    def _place(self, placement: volume_stream_pb2.VolumePlacement) -> None:
        self._placement = placement
        # A replay's begins with its voxels.
        if (self._copy is self._shown and self.volume is not None
                and self.volume.replayed == placement.replayed):
            with self.lock:
                self.volume = dataclasses.replace(self.volume, **place_of(placement))

    def _complete(self, copy: VolumeCopy, complete: volume_stream_pb2.VolumeComplete) -> None:
        if self._placement is None:
            raise ValueError("no placement")
        volume = copy.complete(complete, self._placement)
        with self.lock:
            self.volume = volume
            self.changed.notify_all()
        self._shown = copy
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
forget_in_child(_followers)


@atexit.register
def _end_all() -> None:
    # As in _poses.py: a thread that the interpreter's end stops within gRPC keeps gRPC's locks.
    for follower in list(_followers):
        follower.close()


class LiveVolume:
    """A copy of the volume that stays equal to the daemon's; VolumeAccess.follow() makes one.

    A thread of its own takes what the daemon sends. It moves the copy from one revision to a later
    one in one step. If changes are fast, it may skip revisions.

    - live[x0:x1, y0:y1, z0:z1] is a part of the newest revision, as of an array, in memory of its
      own. It needs no array of the whole volume.
    - snapshot() is the whole newest revision. It costs no copy of voxels and never changes: use it
      for several parts of one revision.
    - `values`, active_bricks(), tiles() and to_openvdb() are those of a snapshot of now.

    The types of voxels are those of Volume.

    If the daemon goes away, the copy stays as it was, `lost` says why, and the thread tries to
    resume until it is closed. After resuming, the daemon sends only what has changed. After a
    restart of the daemon, or for another volume, the daemon sends all voxels. The new volume
    appears when it is complete.

    Any thread. A `with` block closes it, and so does the end of the last reference.
    Example: with conn.volume.follow() as live: print(live[10:20, 0:64, 3].max())
    """

    def __init__(self, link: Link, stub: typing.Any) -> None:
        # A separate object: the thread must not keep this object alive.
        self._follower = _Follower(link, stub)

    @property
    def values(self) -> Voxels:
        """(nx, ny, nz), indexed [x, y, z], data units, of the file's own type. Read-only.

        The array is of the newest revision and never changes. It is made once for each revision
        that is asked for. Waits for the first copy. Errors: as wait(), TooLarge (an array of more
        than 2³¹ voxels: take parts).
        """
        return self._now()._bricks.values

    def __getitem__(self, key: typing.Any) -> typing.Any:
        return self._now()[key]

    def active_bricks(self) -> collections.abc.Iterator[tuple[npt.NDArray[np.int64], Voxels]]:
        """As Volume.active_bricks(), of one revision. Waits for the first copy. Errors: as wait().

        Example: total = sum(values.sum(dtype=float) for _, values in live.active_bricks())
        """
        return self._now().active_bricks()

    def tiles(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Voxels]:
        """As Volume.tiles(). Waits for the first copy. Errors: as wait().

        Example: for begin, end, value in zip(*live.tiles()): print(begin, end, value)
        """
        return self._now().tiles()

    def to_openvdb(self) -> typing.Any:
        """As Volume.to_openvdb(). Waits for the first copy.

        Errors: as wait(), FailedPrecondition (pyopenvdb is not installed).
        Example: grid = live.to_openvdb()
        """
        return self._now().to_openvdb()

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
        """Returns the newest revision, which never changes. Waits for the first copy.

        Errors: as wait(). Example: values = live.snapshot().values
        """
        # Another object: its `values` are its holder's own.
        return dataclasses.replace(self._now())

    @contextlib.contextmanager
    def held(self) -> collections.abc.Iterator[Volume]:
        """Keeps the copy at its revision for a `with` block, and returns a snapshot() of it.

        Keep the block short: meanwhile nothing newer is shown. wait() lets it move on. Errors: as
        wait().
        Example: with live.held() as volume: assert live.volume_revision == volume.volume_revision
        """
        self.wait()
        with self._follower.lock:
            yield self.snapshot()

    def wait(self, volume_revision: int = 0, timeout_s: float | None = None) -> int:
        """Waits until the copy has this revision or a later one. Returns the copy's revision.

        volume_revision: such as EditResult.volume_revision; 0: any. timeout_s: in seconds; None:
        no limit, also while the daemon is away.
        Errors: InvalidArgument, Unavailable (closed, or not within timeout_s), PermissionDenied,
        TooLarge (more than 2³⁶ voxels), FailedPrecondition (palpated of another version).
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
        return (f"<palpate live volume: {volume.source}, {volume.shape}, revision "
                f"{volume.volume_revision}{lost}>")
