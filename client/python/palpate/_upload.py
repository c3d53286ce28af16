"""Uploads a volume, with progress and cancellation."""

import collections.abc
import contextlib
import queue
import typing
import zlib

from palpate._link import Link
from palpate._progress import Progress, tell
from palpate.v1 import volume_pb2

_CHUNK_BYTES = 1 << 20
# As on the command line: after all bytes are sent, the daemon still has to read the file.
_SENDING_SHARE = 0.5
_POLL_S = 0.05

Parts = collections.abc.Sequence[bytes | memoryview]


def send_volume(link: Link, stub: typing.Any, name: str, parts: Parts,
                options: volume_pb2.LoadVolumeRequest, progress: Progress | None,
                files: collections.abc.Sequence[str] | None = None
                ) -> volume_pb2.UploadVolumeResponse:
    """Sends a file made of these parts, or a folder with one file for each part.

    Errors: palpate.Error, and exceptions of `progress`.
    """
    link.call(stub.GetVolume, volume_pb2.GetVolumeRequest())  # waits for the first volume
    crc32 = 0
    for part in parts:
        crc32 = zlib.crc32(part, crc32)
    size_bytes = sum(map(len, parts))
    start = volume_pb2.UploadVolumeStart(name=name, size_bytes=size_bytes, crc32=crc32,
                                         options=options)
    for file, part in zip(files or (), parts):
        start.files.add(name=file, size_bytes=len(part))
    requests = _requests(start, parts)
    # gRPC reads the requests on a thread of its own. `progress` is called on this thread.
    news: queue.SimpleQueue[tuple[str, float] | None] = queue.SimpleQueue()
    call = link.begin(stub.UploadVolume.future, _counted(requests, size_bytes, news))
    call.add_done_callback(lambda _: news.put(None))
    told: tuple[str, float] | None = ("sending", 0.0)
    try:
        while told is not None:
            tell(progress, *told)
            # While the daemon loads, no news comes. The timeout lets `progress` cancel then, too.
            with contextlib.suppress(queue.Empty):
                told = news.get(timeout=_POLL_S)
    except BaseException:
        call.cancel()
        raise
    answer: volume_pb2.UploadVolumeResponse = link.result_of(call)
    return answer


def _requests(start: volume_pb2.UploadVolumeStart,
              parts: Parts) -> collections.abc.Iterator[volume_pb2.UploadVolumeRequest]:
    yield volume_pb2.UploadVolumeRequest(start=start)
    for part in parts:
        for first in range(0, len(part), _CHUNK_BYTES):
            yield volume_pb2.UploadVolumeRequest(data=bytes(part[first:first + _CHUNK_BYTES]))


def _counted(requests: collections.abc.Iterator[volume_pb2.UploadVolumeRequest], size_bytes: int,
             news: "queue.SimpleQueue[tuple[str, float] | None]"
             ) -> collections.abc.Iterator[volume_pb2.UploadVolumeRequest]:
    sent = 0
    for request in requests:
        yield request
        # gRPC asks for the next request when this one is sent.
        sent += len(request.data)
        if sent < size_bytes:
            news.put(("sending", _SENDING_SHARE * sent / size_bytes))
    news.put(("loading", _SENDING_SHARE))
