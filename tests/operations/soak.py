"""Everything at once, for as long as it is told to: viewers of poses and voxels, edits,
settings, a time series, recordings, and the metrics read once a second. Memory and
files must stay what they were, and the proxy must never be inside the material.

Memory is the daemon's resident set, from its metrics. The first third of the run is
warm-up (caches, arenas of malloc, the frames of the series, each with its edits). Of
the rest, the median of the first half is compared with that of the second: a leak that
matters moves it, and one sample at the top of a burst does not. In less than ten minutes
4 MiB are forgiven: gRPC makes a few more threads, of 1 MiB each, when the machine stops, and
what piles up meanwhile stays with malloc. The daemon's malloc has one arena instead of one
for each few threads: those fill for some three minutes, which a short run would take for a
leak."""

import argparse
import itertools
import os
import random
import statistics
import sys
import time

import numpy as np

from crowd import VolumeReader, Worker, faults, verdict
from support import SANITIZED, Client, Daemon, PoseReader, nrrd, parse_metrics, scrape

EDGE = 48
FRAMES = 4
FLAT = 0.01
SHORT_S = 600
SHORT_FLAT_BYTES = 4 << 20
MORE_THREADS = 4
WARM_UP = 1 / 3


def write_frames(folder):
    """Balls of growing radius."""
    distance = np.linalg.norm(np.indices((EDGE,) * 3) - (EDGE - 1) / 2, axis=0)
    for frame in range(FRAMES):
        values = (1.0 - distance / (28.0 + 4.0 * frame)).clip(0.0)
        (folder / f"t{frame}.nrrd").write_bytes(nrrd(values))


class Soak:
    def __init__(self, daemon):
        self.daemon = daemon
        self.readings = []  # (seconds, metrics, threads)
        self._clients = [Client(daemon) for _ in range(7)]
        self._conn = daemon.connect()
        self._began_s = time.monotonic()
        random.seed(1)

    def start(self):
        clients = self._clients
        self._play_series()
        settings, edits, recordings = itertools.count(), itertools.count(), itertools.count()
        # In time for the 16 messages that may be under way; each costs Python a millisecond.
        sparing = {"acknowledge_every": 4}
        self.readers = [PoseReader(clients[n], 60.0, **sparing) for n in range(5)]
        self.readers += [PoseReader(clients[5], 1000.0, 10, **sparing), VolumeReader(clients[6])]
        place = lambda: random.uniform(0, EDGE - 1)
        self.workers = [
            Worker("settings", 50, lambda: clients[1].set_stiffness(
                0.4 + 0.01 * (next(settings) % 20))),
            Worker("edits", 20, lambda: next(edits) + clients[2].carve(
                place(), place(), place(), 4.0).volume_revision),
            Worker("recordings", 0.2, lambda: self._record_anew(next(recordings))),
            Worker("scrapes", 1, self._scrape),
            # Viewers come and go; not in step with the scrapes, which would see each of them.
            Worker("visits", 0.73, self._visit)]

    def _play_series(self):
        write_frames(self.daemon.folder)
        self._conn.series.load(self.daemon.folder / "t*.nrrd")
        self._conn.series.configure(loop=True)
        self._conn.series.play(10)

    def _record_anew(self, number):
        if number:
            self._conn.recording.stop()
        self._conn.recording.start(self.daemon.folder / "soak.mcap", overwrite=True)

    def _visit(self):
        with Client(self.daemon) as visitor:
            visitor.read_poses(3)
            visitor.settings()

    def _scrape(self):
        values = parse_metrics(scrape(self.daemon.metrics_port))[1]
        self.readings.append((time.monotonic() - self._began_s, values, self.daemon.threads()))

    def stop(self):
        for worker in self.workers:
            worker.stop()
        for reader in self.readers:
            reader.stop()
        for client in self._clients:
            client.channel.close()
        self._conn.close()

    def failures(self):
        """What was wrong, in words; prints the figures."""
        found = faults(self.workers, self.readers)
        found += [f"{w.name}: none" for w in self.workers if not w.calls]
        end_s = self.readings[-1][0]
        warm = [r for r in self.readings if r[0] > WARM_UP * end_s]
        halves = warm[:len(warm) // 2], warm[len(warm) // 2:]

        def middle(name):
            return [statistics.median_low(v[name] for _, v, _ in half) for half in halves]

        threads = [statistics.median_low(count for _, _, count in half) for half in halves]
        memory = middle("palpate_resident_memory_bytes")
        # Visitors open some for a moment, and recordings close theirs for one.
        files = middle("palpate_open_files")
        last = self.readings[-1][1]
        grown = memory[1] - memory[0]
        print(f"{end_s:.0f} s, {last['palpate_ticks_total']:.0f} ticks, "
              + ", ".join(f"{w.calls} {w.name}" for w in self.workers))
        print(f"memory {memory[0] / 1e6:.2f} MB, then {grown / 1e6:+.2f} MB; files {files[0]:.0f}, "
              f"then {files[1]:.0f}; threads {threads[0]}, then {threads[1]}; " + ", ".join(
                  f"{name} {last[f'palpate_{name}_total']:.0f}" for name in
                  ("missed_ticks", "lost_samples", "contact_faults", "contact_ticks")))
        if grown > max(FLAT * memory[0], SHORT_FLAT_BYTES * (end_s < SHORT_S)) and not SANITIZED:
            found.append(f"memory grew by {grown / memory[0]:.2%}")
        if files[1] > files[0]:
            found.append(f"files grew from {files[0]:.0f} to {files[1]:.0f}")
        if threads[1] > threads[0] + MORE_THREADS:
            found.append(f"threads grew from {threads[0]} to {threads[1]}")
        for name in ("palpate_contact_faults_total", "palpate_faulty_ticks_total"):
            if last[name]:
                found.append(f"{name} is {last[name]:.0f}")
        if not last["palpate_contact_ticks_total"]:
            found.append("nothing was felt")
        return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=120.0)
    seconds = parser.parse_args().seconds
    os.environ["MALLOC_ARENA_MAX"] = "1"
    with Daemon(f"builtin:sphere:{EDGE}", metrics=True) as daemon:
        soak = Soak(daemon)
        soak.start()
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and not any(w.error for w in soak.workers):
            time.sleep(0.2)
        soak.stop()
        return verdict(daemon, soak.failures())


if __name__ == "__main__":
    sys.exit(main())
