"""Everything that takes memory, at once and one after the other: loads, uploads, edits, undo,
filters, a series, saves, recordings to a full disk, and ten streams of volumes, some of which
nobody reads. The daemon's memory must never be above its budget and the overhead that the guides
state; what does not fit must be refused in words that name the budget; and at the end all memory
must be back.

Memory is what the daemon has of its own, without the pages of programs and libraries (RssAnon and
RssShmem), looked at every 20 ms. The overhead is what it has with builtin:sphere:16 and no client,
and OVERHEAD_MIB. "Back" is compared with a first round of the same calls, which makes the threads
and connections that stay."""

import argparse
import array
import functools
import itertools
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import time
import zlib

import grpc

import crash
from crowd import VolumeReader, Worker, faults
from palpate.v1 import edit_pb2, recording_pb2, series_pb2, series_pb2_grpc, volume_pb2
from support import PATIENCE_S, SANITIZED, Client, Daemon, parse_metrics, scrape

BUDGET_MIB = 300
OVERHEAD_MIB = 64
PERIOD_S = 0.02
SAME = 0.02
SAME_MIB = 6.0
READERS = 10
STANDING_READERS = 4
EDGE = 96  # of the volume that is there at the start and at the end
FRAMES = 6
# Refusals that are right while others load, edit or end streams at the same time.
BUSY = (grpc.StatusCode.ABORTED, grpc.StatusCode.FAILED_PRECONDITION,
        grpc.StatusCode.INVALID_ARGUMENT)
TYPES = {"B": volume_pb2.VOXEL_TYPE_UINT8, "h": volume_pb2.VOXEL_TYPE_INT16,
         "f": volume_pb2.VOXEL_TYPE_FLOAT32}
# Edge and type; the last two never fit.
LOADS = [(96, "B"), (128, "f"), (160, "h"), (200, "f"), (224, "B"), (256, "h"), (256, "f"),
         (384, "f"), (640, "B")]


def own_mib(pid):
    """Of the process, that is of no file."""
    with open(f"/proc/{pid}/status", encoding="ascii") as status:
        fields = dict(line.split(":", 1) for line in status)
    return sum(int(fields[key].split()[0]) for key in ("RssAnon", "RssShmem")) / 1024


def noise(edge, kind, seed):
    """Voxels no two of which are alike in a row, quickly."""
    block = random.Random(seed).randbytes(1 << 16)
    if kind == "f":
        block = array.array("f", [byte + n % 7 for n, byte in enumerate(block)]).tobytes()
    size = edge ** 3 * array.array(kind).itemsize
    return (block * (size // len(block) + 1))[:size]


class Sampler:
    """The greatest memory so far."""

    def __init__(self, pid):
        self._pid, self.most_mib = pid, 0.0
        self.worker = Worker("looks", 1 / PERIOD_S, self._look)

    def _look(self):
        self.most_mib = max(self.most_mib, own_mib(self._pid))


class Script:
    """The calls. Each returns when it is answered; refusals are counted and judged."""

    def __init__(self, daemon, folder, full_folder):
        self.daemon, self.folder, self.full = daemon, folder, full_folder
        self.refused, self.done, self.wrong = {}, {}, []
        self._random = random.Random(1)
        self._numbers = itertools.count()
        for edge, kind in LOADS[:-2]:
            (folder / f"{edge}{kind}.raw").write_bytes(noise(edge, kind, edge))
        for edge, kind in LOADS[-2:]:
            # Sparse: nobody reads them.
            with open(folder / f"{edge}{kind}.raw", "wb") as file:
                file.truncate(edge ** 3 * array.array(kind).itemsize)
        for frame in range(FRAMES):
            (folder / f"t{frame}.nrrd").write_bytes(
                b"NRRD0004\ntype: float\ndimension: 3\nsizes: 96 96 96\nspacings: 1 1 1\n"
                b"endian: little\nencoding: raw\n\n" + noise(96, "f", 1000 + frame))

    def call(self, name, make):
        """Makes a call and judges how it ended."""
        try:
            make()
            self.done[name] = self.done.get(name, 0) + 1
        except grpc.RpcError as error:
            code, text = error.code(), error.details()
            if code == grpc.StatusCode.RESOURCE_EXHAUSTED:
                self.refused[name] = self.refused.get(name, 0) + 1
                clear = f"{BUDGET_MIB} MiB" in text and "volume.memory_budget_mib" in text
                other = "voxels" in text or "No space left" in text  # an edit's limit; the disk's
                if not clear and not other:
                    self.wrong.append(f"{name}: refused unclearly: {text}")
            elif code not in BUSY:
                self.wrong.append(f"{name}: {code.name}: {text}")

    def load(self, client, edge, kind):
        request = volume_pb2.LoadVolumeRequest(source=str(self.folder / f"{edge}{kind}.raw"))
        request.raw.size_x = request.raw.size_y = request.raw.size_z = edge
        request.raw.type = TYPES[kind]
        self.call("load", lambda: list(client.volume.LoadVolume(request, timeout=PATIENCE_S)))

    def upload(self, client, edge):
        voxels = noise(edge, "f", edge)

        def requests():
            start = volume_pb2.UploadVolumeRequest()
            start.start.name = "noise.raw"
            start.start.size_bytes = len(voxels)
            start.start.crc32 = zlib.crc32(voxels)
            raw = start.start.options.raw
            raw.size_x = raw.size_y = raw.size_z = edge
            raw.type = volume_pb2.VOXEL_TYPE_FLOAT32
            yield start
            for at in range(0, len(voxels), 1 << 20):
                yield volume_pb2.UploadVolumeRequest(data=voxels[at:at + (1 << 20)])
        self.call("upload", lambda: client.volume.UploadVolume(requests(), timeout=PATIENCE_S))

    def edit(self, client):
        request = edit_pb2.EditVolumeRequest(
            frame=edit_pb2.EDIT_FRAME_INDEX, value=self._random.uniform(0.5, 20.0),
            operation=self._random.choice([edit_pb2.EDIT_OPERATION_ADD,
                                           edit_pb2.EDIT_OPERATION_SUBTRACT]))
        center = request.sphere.center
        center.x, center.y, center.z = (self._random.uniform(0, 95) for _ in range(3))
        request.sphere.radius = self._random.choice([4.0, 8.0, 40.0, 110.0])
        self.call("edit", lambda: client.volume.EditVolume(request, timeout=PATIENCE_S))

    def take_back(self, client):
        calls = {"undo": lambda: client.volume.UndoEdit(edit_pb2.UndoEditRequest(),
                                                        timeout=PATIENCE_S),
                 "redo": lambda: client.volume.RedoEdit(edit_pb2.RedoEditRequest(),
                                                        timeout=PATIENCE_S),
                 "revert": lambda: client.volume.RevertVolume(edit_pb2.RevertVolumeRequest(),
                                                              timeout=PATIENCE_S)}
        name = self._random.choice(["undo", "undo", "redo", "redo", "revert"])
        self.call(name, calls[name])

    def filter(self, client):
        kind = self._random.choice([edit_pb2.FILTER_KIND_GAUSSIAN, edit_pb2.FILTER_KIND_MEAN])
        self.call("filter", lambda: list(client.volume.FilterVolume(
            edit_pb2.FilterVolumeRequest(kind=kind, width=1), timeout=PATIENCE_S)))

    def save(self, client):
        path = self.folder / "saved.vdb"
        self.call("save", lambda: list(client.volume.SaveVolume(
            volume_pb2.SaveVolumeRequest(path=str(path), overwrite=True), timeout=PATIENCE_S)))

    def series(self, client):
        series = series_pb2_grpc.SeriesServiceStub(client.channel)
        self.call("series", lambda: list(series.LoadSeries(series_pb2.LoadSeriesRequest(
            sources=[str(self.folder / "t*.nrrd")]), timeout=PATIENCE_S)))
        self.call("play", lambda: series.ControlSeries(series_pb2.ControlSeriesRequest(
            playing=True, rate_hz=7.3, loop=True, interpolate=True), timeout=PATIENCE_S))

    def record(self, client):
        """Anew, as the disk is full after a moment."""
        running = client.recording.GetRecording(recording_pb2.GetRecordingRequest(),
                                                timeout=PATIENCE_S).recording.running
        if running:
            return
        self.call("record", lambda: client.recording.StartRecording(
            recording_pb2.StartRecordingRequest(path=str(self.full / "r.palrec"), overwrite=True),
            timeout=PATIENCE_S))

    def load_something(self, client):
        number = next(self._numbers)
        if number % 4 == 3:
            self.series(client)
            time.sleep(1.0)  # so that it plays
        elif number % 4 == 1:
            self.upload(client, self._random.choice([64, 128, 192, 256]))
        else:
            self.load(client, *self._random.choice(LOADS))

    def first_round(self, client):
        """One of each."""
        for load in LOADS:
            self.load(client, *load)
            self.edit(client)
        self.upload(client, 128)
        self.series(client)
        time.sleep(0.5)
        self.load(client, 128, "f")
        for _ in range(3):
            self.edit(client)
        self.take_back(client)
        self.filter(client)
        self.save(client)
        self.record(client)


def settled_mib(daemon, script, client):
    """With a small volume and no history, once what was freed is back: the least of two seconds
    without a change of more than a hundredth."""
    script.load(client, EDGE, "B")
    script.call("stop", lambda: client.recording.StopRecording(
        recording_pb2.StopRecordingRequest(), timeout=PATIENCE_S))
    last, since = own_mib(daemon.pid), time.monotonic()
    end = since + 30
    while time.monotonic() < min(since + 3.0, end):
        time.sleep(0.1)
        now = own_mib(daemon.pid)
        if abs(now - last) > 0.01 * last:
            last, since = now, time.monotonic()
    return last


def everything(script, seconds):
    """All at once, with the streams."""
    clients = [Client(script.daemon) for _ in range(READERS)]
    readers = [VolumeReader(client, stands=n < STANDING_READERS)
               for n, client in enumerate(clients)]
    rates_hz = [("load_something", 2), ("edit", 20), ("edit", 5), ("take_back", 3), ("filter", 1),
                ("save", 0.2), ("record", 2)]
    callers = [Client(script.daemon) for _ in rates_hz]
    workers = [Worker(name, rate_hz, functools.partial(getattr(script, name), caller))
               for (name, rate_hz), caller in zip(rates_hz, callers)]
    end = time.monotonic() + seconds
    while time.monotonic() < end and not script.wrong:
        time.sleep(0.2)
        for n, reader in enumerate(readers):
            # Those that stand still come again now and then: they hold another volume then.
            if n < STANDING_READERS and random.random() < 0.02:
                reader.stop()
                readers[n] = VolumeReader(clients[n], stands=True)
    for one in [*workers, *readers]:
        one.stop()
    script.wrong += faults(workers, readers)
    for client in [*clients, *callers]:
        client.channel.close()


def run(daemon, folder, full_folder, seconds):
    """What was wrong."""
    time.sleep(1.0)
    idle_mib = own_mib(daemon.pid)
    sampler = Sampler(daemon.pid)
    script = Script(daemon, folder, full_folder)
    with Client(daemon) as client:
        script.first_round(client)
        everything(script, min(10.0, 0.25 * seconds))
        before_mib = settled_mib(daemon, script, client)
        everything(script, seconds)
        after_mib = settled_mib(daemon, script, client)
    metrics = parse_metrics(scrape(daemon.metrics_port))[1]
    held_mib = metrics["palpate_volume_memory_bytes"] / (1 << 20)
    sampler.worker.stop()
    limit_mib = BUDGET_MIB + idle_mib + OVERHEAD_MIB
    print(f"idle {idle_mib:.1f} MiB; at most {sampler.most_mib:.1f} of {limit_mib:.1f} MiB in "
          f"{sampler.worker.calls} looks; with a small volume {before_mib:.1f}, then "
          f"{after_mib:.1f} MiB, as the daemon counts {held_mib:.1f} MiB; "
          f"{metrics['palpate_missed_ticks_total']:.0f} of {metrics['palpate_ticks_total']:.0f} "
          "ticks missed")
    print("done: " + ", ".join(f"{n} {name}" for name, n in sorted(script.done.items())))
    print("refused: " + ", ".join(f"{n} {name}" for name, n in sorted(script.refused.items())))
    found = list(script.wrong)
    found += [f"{name}: none" for name in ("load", "upload", "edit", "undo", "filter", "series",
                                           "save", "record") if name not in script.done]
    if "load" not in script.refused:
        found.append("no load was refused")
    if not SANITIZED and sampler.most_mib > limit_mib:
        found.append(f"{sampler.most_mib:.1f} MiB were above the limit of {limit_mib:.1f} MiB")
    if not SANITIZED and after_mib > max(before_mib * (1 + SAME), before_mib + SAME_MIB):
        found.append(f"{after_mib - before_mib:.1f} MiB were not given back")
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="600 for the long form")
    parser.add_argument("--locked", action="store_true", help="with [realtime] lock_memory")
    options = parser.parse_args()
    lock = "true" if options.locked else "false"
    with tempfile.TemporaryDirectory(prefix="palpate-budget-") as folder, \
            tempfile.TemporaryDirectory(prefix="palpate-full-",
                                        ignore_cleanup_errors=True) as full:
        mounted = os.geteuid() == 0 and subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", full], check=False).returncode == 0
        config = {"volume": [f"memory_budget_mib = {BUDGET_MIB}",
                             f'save_folders = ["{folder}", "{full}"]'],
                  "realtime": [f"lock_memory = {lock}"]}
        try:
            with Daemon("builtin:sphere:16", config=config, metrics=True) as daemon:
                found = run(daemon, pathlib.Path(folder), pathlib.Path(full), options.seconds)
                status = daemon.end()
                if status:
                    found.append(f"palpated ended with {status}: {''.join(daemon.said[-5:])}")
        finally:
            if mounted:
                subprocess.run(["umount", "-q", "-l", full], check=False)
    found += crash.found
    for line in found[:20]:
        print(f"FAILED: {line}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
