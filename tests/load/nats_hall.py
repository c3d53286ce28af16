"""How many guests a lecture hall has on one machine: palpated with its simulated device, a publishing
palpate-web, nats-server, receiving palpate-webs, and guests at 60 Hz who join them in equal parts.

For each count: the ages of the poses when guests get them, and the processors that each program
took, the guests themselves (web_guests) as well. With --guests, that many for all of --seconds: each
minute's figures are appended to --csv, and the end says whether memory or files grew.

Memory is the resident set. The first third is warm-up; of the rest, the median of the first half is
compared with that of the second: more than 1 % is growth, and 4 MiB are forgiven in runs of less
than ten minutes."""

import argparse
import csv
import json
import pathlib
import queue
import statistics
import subprocess
import sys
import threading
import time

from room import KEY, Room, machine_s, open_files, processor_s, resident_bytes
from support import PALPATED

WEB_GUESTS = pathlib.Path(PALPATED).parent.parent / "tests" / "web_guests"
CONFIG = "[web]\nmax_guests = 960\n"
BOUND_MS = 100.0
RAMP = [150, 300, 600, 900, 1200, 1800, 2400, 2850]
WARM_UP = 1 / 3
FLAT = 0.01
SHORT_S = 600
SHORT_FLAT_BYTES = 4 << 20


class Crowd:
    """Guests at all receivers, a process for each receiver, until end(). All have joined when this is
    made."""

    def __init__(self, room, guests, window_s):
        counts = [guests // len(room.receivers)] * len(room.receivers)
        counts[0] += guests - sum(counts)
        self.processes = [
            subprocess.Popen([WEB_GUESTS, "127.0.0.1", str(receiver.port), KEY, str(count),
                              str(window_s), "0", "1000000"], stdout=subprocess.PIPE, text=True)
            for receiver, count in zip(room.receivers, counts)]
        # Each is read at once: a report is larger than a pipe, and guests do not read meanwhile.
        self._reports = [queue.Queue() for _ in self.processes]
        self._threads = [threading.Thread(target=self._read, args=pair)
                         for pair in zip(self.processes, self._reports)]
        for thread in self._threads:
            thread.start()
        self.window()
        # Some joined sooner than others: what they have reported meanwhile, and the window that they
        # are in.
        for reports in self._reports:
            while not reports.empty():
                reports.get()
        self.window()

    @staticmethod
    def _read(process, reports):
        for line in process.stdout:
            reports.put(line)
        reports.put("")

    def window(self):
        """The guests' figures of one window, once it is over."""
        reports = [json.loads(reports.get()) for reports in self._reports]
        clients = [client for report in reports for client in report["clients"]]
        ages = [client["age_ms"] for client in clients if client["age_ms"]]
        if not ages:
            raise RuntimeError("no guest got a pose")
        seconds = max(report["seconds"] for report in reports)
        return {"guests": len(clients), "worst_p99_ms": max(age["p99"] for age in ages),
                "median_p99_ms": statistics.median(age["p99"] for age in ages),
                "median_p50_ms": statistics.median(age["p50"] for age in ages),
                "least_hz": min(client["poses"] for client in clients) / seconds,
                "longest_gap_ms": max(client["longest_gap_ms"] for client in clients),
                "lost": sum(report["lost"] for report in reports)}

    def end(self):
        for process in self.processes:
            process.kill()
        for process, thread in zip(self.processes, self._threads):
            process.wait()
            thread.join()
            process.stdout.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()


class Shares:
    """Of the processors, by program, since the last call."""

    def __init__(self, room, crowd):
        self._pids = room.processes() | {f"guests {n}": process.pid
                                         for n, process in enumerate(crowd.processes)}
        self._before = self._now()

    def _now(self):
        machine, host = machine_s()
        return {name: processor_s(pid) for name, pid in self._pids.items()} | {
            "machine": machine, "stolen": host, "time": time.monotonic()}

    def take(self):
        now, before = self._now(), self._before
        self._before = now
        seconds = now["time"] - before["time"]
        shares = {name: (now[name] - before[name]) / seconds for name in now if name != "time"}
        own = sum(shares[name] for name in self._pids)
        return shares | {"others": max(0.0, shares["machine"] - own)}


def text_of(shares):
    return ", ".join(f"{name} {share:.2f}" for name, share in shares.items())


def bottleneck(shares):
    """In words: who had no more processor to get."""
    parts = {name: share for name, share in shares.items()
             if name not in ("machine", "stolen")}
    full = [name for name, share in parts.items() if share > 0.9]
    greatest = max(parts, key=parts.get)  # "others": programs that are no part of this
    by_guests = sum(share for name, share in parts.items() if name.startswith("guests"))
    return (f"{', '.join(full)} at a whole processor; " if full else "") + (
        f"the machine's programs took {shares['machine']:.2f} processors, the guests "
        f"{by_guests:.2f} of them; most: {greatest} with {parts[greatest]:.2f}")


def step(room, guests, seconds):
    """The figures of so many guests."""
    with Crowd(room, guests, seconds) as crowd:
        shares = Shares(room, crowd)
        figures = crowd.window()
        return figures, shares.take()


def ramp(room, counts, seconds):
    """Prints a line for each count, and between which the bound is passed: where it stays passed at
    the next count, too, so that one moment of somebody else's does not count."""
    below, passed = 0, None
    for guests in counts:
        figures, shares = step(room, guests, seconds)
        print(f"{figures['guests']} guests: p99 of the worst {figures['worst_p99_ms']:.1f} ms, of "
              f"the median guest {figures['median_p99_ms']:.1f} ms (p50 "
              f"{figures['median_p50_ms']:.1f}); the least gets {figures['least_hz']:.1f} poses/s; "
              f"{figures['lost']} lost; processors: {text_of(shares)}", flush=True)
        if figures["lost"]:
            for receiver in room.receivers:
                print("  a receiver said: " + "".join(receiver.said[-2:]).strip())
        if figures["worst_p99_ms"] <= BOUND_MS and not figures["lost"]:
            below, passed = guests, None
        elif passed:
            break
        else:
            passed = guests, bottleneck(shares)
    if passed:
        print(f"p99 passes {BOUND_MS:.0f} ms between {below} and {passed[0]} guests: {passed[1]}")
    else:
        print(f"p99 stays below {BOUND_MS:.0f} ms to {below} guests")


def watch(room, guests, seconds, window_s, file):
    """The long run. What was wrong, in words."""
    windows = max(1, round(seconds / window_s))
    rows, found = [], []
    with Crowd(room, guests, window_s) as crowd:
        began_s = time.monotonic()
        shares = Shares(room, crowd)
        writer = None
        for _ in range(windows):
            figures = crowd.window()
            row = {"seconds": round(time.monotonic() - began_s)} | figures | {
                f"cores {name}": round(share, 3) for name, share in shares.take().items()}
            for name, pid in room.processes().items():
                row |= {f"rss {name}": resident_bytes(pid), f"files {name}": open_files(pid)}
            if writer is None:
                writer = csv.DictWriter(file, row)
                writer.writeheader()
            writer.writerow(row)
            file.flush()
            rows.append(row)
            print(f"{row['seconds']} s: worst p99 {row['worst_p99_ms']:.1f} ms, least "
                  f"{row['least_hz']:.1f} poses/s, {row['lost']} lost; MB " + ", ".join(
                      f"{name} {row[f'rss {name}'] / 1e6:.1f}" for name in room.processes()),
                  flush=True)
    if rows[-1]["lost"]:
        found.append(f"{rows[-1]['lost']} guests were lost")
    return found + growth(rows, seconds, room.processes())


def growth(rows, seconds, names):
    """Of memory and files."""
    warm = [row for row in rows if row["seconds"] > WARM_UP * seconds] or rows
    if len(warm) < 2:
        return []
    halves = warm[:len(warm) // 2], warm[len(warm) // 2:]
    found = []
    for name in names:
        memory, files = ([statistics.median_low(row[f"{kind} {name}"] for row in half)
                          for half in halves] for kind in ("rss", "files"))
        grown = memory[1] - memory[0]
        print(f"{name}: {memory[0] / 1e6:.2f} MB, then {grown / 1e6:+.2f} MB; files {files[0]}, "
              f"then {files[1]}")
        if grown > max(FLAT * memory[0], SHORT_FLAT_BYTES * (seconds < SHORT_S)):
            found.append(f"{name}: memory grew by {grown / memory[0]:.2%}")
        if files[1] > files[0]:
            found.append(f"{name}: files grew from {files[0]} to {files[1]}")
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ramp", type=int, nargs="+", default=RAMP, metavar="GUESTS")
    parser.add_argument("--seconds", type=float, default=5.0,
                        help="of each count, or of all with --guests [5]")
    parser.add_argument("--guests", type=int, help="so many, for all of the time")
    parser.add_argument("--window", type=float, default=60.0, help="seconds of a row [60]")
    parser.add_argument("--csv", default="nats_hall.csv", help="of --guests [nats_hall.csv]")
    parser.add_argument("--receivers", type=int, default=3)
    parser.add_argument("--volume", default="builtin:bumps:64")
    parser.add_argument("--direct", action="store_true",
                        help="without NATS, for comparison: all at palpated itself")
    options = parser.parse_args()
    with Room(options.receivers, {"volume": options.volume}, CONFIG,
              is_direct=options.direct) as room:
        if not options.guests:
            ramp(room, options.ramp, options.seconds)
            return 0
        with open(options.csv, "w", encoding="ascii") as file:
            found = watch(room, options.guests, options.seconds,
                          min(options.window, options.seconds), file)
    for line in found:
        print(f"FAILED: {line}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
