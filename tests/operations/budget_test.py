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
import contextlib
import functools
import itertools
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import time

import numpy as np

import palpate
from crowd import VolumeReader, Worker, faults, verdict
from support import SANITIZED, Client, Daemon, nrrd, parse_metrics, scrape

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
BUSY = (palpate.Conflict, palpate.FailedPrecondition, palpate.InvalidArgument)
# Edge and type; the last two never fit.
LOADS = [(96, "uint8"), (128, "float32"), (160, "int16"), (200, "float32"), (224, "uint8"),
         (256, "int16"), (256, "float32"), (384, "float32"), (640, "uint8")]


def own_mib(pid):
    """Of the process, that is of no file."""
    with open(f"/proc/{pid}/status", encoding="ascii") as status:
        fields = dict(line.split(":", 1) for line in status)
    return sum(int(fields[key].split()[0]) for key in ("RssAnon", "RssShmem")) / 1024


def noise(edge, kind, seed):
    """Voxels no two of which are alike in a row, quickly."""
    values = np.random.default_rng(seed).integers(0, 127, 1 << 16).astype(kind)
    return np.resize(values, (edge,) * 3)


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
            noise(edge, kind, edge).tofile(folder / f"{edge}{kind}.raw")
        for edge, kind in LOADS[-2:]:
            # Sparse: nobody reads them.
            with open(folder / f"{edge}{kind}.raw", "wb") as file:
                file.truncate(edge ** 3 * np.dtype(kind).itemsize)
        for frame in range(FRAMES):
            (folder / f"t{frame}.nrrd").write_bytes(nrrd(noise(EDGE, "float32", 1000 + frame)))

    def call(self, name, make, *arguments, **options):
        """Makes a call and judges how it ended."""
        try:
            make(*arguments, **options)
            self.done[name] = self.done.get(name, 0) + 1
        except (palpate.TooLarge, palpate.DiskFull) as error:
            self.refused[name] = self.refused.get(name, 0) + 1
            text = str(error)
            clear = f"{BUDGET_MIB} MiB" in text and "volume.memory_budget_mib" in text
            # An edit's limit; the disk's, seen before or on the way.
            other = any(words in text for words in ("voxels", "No space left", "make space"))
            if not clear and not other:
                self.wrong.append(f"{name}: refused unclearly: {text}")
        except BUSY:
            pass
        except palpate.Error as error:
            self.wrong.append(f"{name}: {error!r}")

    def load(self, conn, edge, kind):
        self.call("load", conn.volume.load, self.folder / f"{edge}{kind}.raw",
                  raw=palpate.Raw((edge,) * 3, kind), discard_edits=True)

    def upload(self, conn, edge):
        self.call("upload", conn.volume.upload, noise(edge, "float32", edge), discard_edits=True)

    def edit(self, conn):
        self.call("edit", conn.edit.sphere, [self._random.uniform(0, 95) for _ in range(3)],
                  self._random.choice([4.0, 8.0, 40.0, 110.0]),
                  self._random.choice(["add", "subtract"]), self._random.uniform(0.5, 20.0),
                  frame="index")

    def take_back(self, conn):
        name = self._random.choice(["undo", "undo", "redo", "redo", "revert"])
        self.call(name, getattr(conn.edit, name))

    def filter(self, conn):
        self.call("filter", conn.edit.filter, self._random.choice(["gaussian", "mean"]))

    def save(self, conn):
        self.call("save", conn.volume.save, self.folder / "saved.vdb", overwrite=True)

    def series(self, conn):
        self.call("series", conn.series.load, self.folder / "t*.nrrd", discard_edits=True)
        self.call("configure", conn.series.configure, loop=True, interpolate=True)
        self.call("play", conn.series.play, 7.3)

    def record(self, conn):
        """Anew, on a disk that is full a moment later."""
        if conn.recording.state().running:
            return
        ballast = self.full / "ballast"
        ballast.unlink(missing_ok=True)
        self.call("record", conn.recording.start, self.full / "r.mcap", overwrite=True)
        if os.path.ismount(self.full):
            disk = os.statvfs(self.full)
            # The recording takes some of it meanwhile.
            with open(ballast, "wb") as file, contextlib.suppress(OSError):
                os.posix_fallocate(file.fileno(), 0,
                                   disk.f_bavail * disk.f_frsize - (2 << 20))

    def load_something(self, conn):
        number = next(self._numbers)
        if number % 4 == 3:
            self.series(conn)
            time.sleep(1.0)  # so that it plays
        elif number % 4 == 1:
            self.upload(conn, self._random.choice([64, 128, 192, 256]))
        else:
            self.load(conn, *self._random.choice(LOADS))

    def first_round(self, conn):
        """One of each."""
        for load in LOADS:
            self.load(conn, *load)
            self.edit(conn)
        self.upload(conn, 128)
        self.series(conn)
        time.sleep(0.5)
        self.load(conn, 128, "float32")
        for _ in range(3):
            self.edit(conn)
        for call in (self.take_back, self.filter, self.save, self.record):
            call(conn)


def settled_mib(daemon, script, conn):
    """With a small volume and no history, once what was freed is back: the least of two seconds
    without a change of more than a hundredth."""
    script.load(conn, EDGE, "uint8")
    script.call("stop", conn.recording.stop)
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
    callers = contextlib.ExitStack()
    workers = [Worker(name, rate_hz, functools.partial(
        getattr(script, name), callers.enter_context(script.daemon.connect())))
               for name, rate_hz in rates_hz]
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
    callers.close()
    for client in clients:
        client.channel.close()


def run(daemon, folder, full_folder, seconds):
    """What was wrong."""
    time.sleep(1.0)
    idle_mib = own_mib(daemon.pid)
    sampler = Sampler(daemon.pid)
    script = Script(daemon, folder, full_folder)
    with daemon.connect() as conn:
        script.first_round(conn)
        everything(script, min(10.0, 0.25 * seconds))
        before_mib = settled_mib(daemon, script, conn)
        everything(script, seconds)
        after_mib = settled_mib(daemon, script, conn)
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
    parser.add_argument("--seconds", type=float, help="600 with tests/run.sh --all [20]",
                        default=float(os.environ.get("PALPATE_BUDGET_S", "20")))
    parser.add_argument("--locked", action="store_true", help="with [realtime] lock_memory")
    options = parser.parse_args()
    lock = "true" if options.locked else "false"
    with tempfile.TemporaryDirectory(prefix="palpate-budget-") as folder, \
            tempfile.TemporaryDirectory(prefix="palpate-full-",
                                        ignore_cleanup_errors=True) as full:
        mounted = os.geteuid() == 0 and subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=128m", "tmpfs", full], check=False).returncode == 0
        config = {"volume": [f"memory_budget_mib = {BUDGET_MIB}",
                             f'save_folders = ["{folder}", "{full}"]'],
                  "realtime": [f"lock_memory = {lock}"]}
        try:
            with Daemon("builtin:sphere:16", config=config, metrics=True) as daemon:
                return verdict(daemon, run(daemon, pathlib.Path(folder), pathlib.Path(full),
                                           options.seconds))
        finally:
            if mounted:
                subprocess.run(["umount", "-q", "-l", full], check=False)


if __name__ == "__main__":
    sys.exit(main())
