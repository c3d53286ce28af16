"""How long a late joiner waits: a receiving palpate-web that starts in a room with a volume of 512^3
bytes, until its guests are shown a whole volume, and until one of them has copied it. At rest, and
while Python changes 200 groups twenty times a second.

Beside it, palpated itself: how long its gateway took for its first manifest, and that gateway to
bring the room to NATS."""

import argparse
import json
import sys
import threading
import time

import numpy as np

from copy_guest import CopyGuest
from gateway import Guest
from room import KEY, Room, hash_of_palpated, machine_s
from support import PATIENCE_S, wait_until

# Of this many groups: two layers of 10 x 10, on both sides of a boundary between groups.
GROUPS_EDITED = 200
EDITED = ((0, 0, 31), (319, 319, 32))


def texture(edge):
    """Bytes that zstd halves: noise of 16 values on steps of one group each."""
    random = np.random.default_rng(5)
    values = random.integers(0, 16, (edge,) * 3, np.uint8)
    wave = (96 + 60 * np.sin(np.arange(edge) // 32)).astype(np.uint8)
    return values + wave[:, None, None] + (wave // 4)[None, :, None]


class Editor:
    """Changes GROUPS_EDITED groups at a rate, in a `with` block."""

    def __init__(self, daemon, rate_hz):
        self._daemon, self._period_s = daemon, 1.0 / rate_hz
        self._over = threading.Event()
        self.edits, self.seconds = 0, 0.0
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        begin = time.monotonic()
        with self._daemon.connect() as conn:
            while not self._over.is_set():
                conn.edit.box(*EDITED, "add", 1.0 if self.edits % 2 == 0 else -1.0, frame="index")
                self.edits += 1
                self._over.wait(max(0.0, begin + self.edits * self._period_s - time.monotonic()))
        self.seconds = time.monotonic() - begin

    def __enter__(self):
        self._thread.start()
        time.sleep(1.0)
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join(PATIENCE_S)


def join(room, seconds):
    """The new receiver, and what a guest of it says; the times count from the receiver's start."""
    guest = CopyGuest(KEY, seconds)
    used, began = machine_s()[0], time.monotonic()
    receiver = room.receive()
    guest.go(receiver.port, began)
    figures = guest.figures()
    return receiver, figures | {"cores": (machine_s()[0] - used) / (time.monotonic() - began)}


def wait_for_hash(receiver, wanted):
    """How long until its guests are shown the volume of this content hash."""
    began = time.monotonic()
    with Guest(receiver) as guest:
        def is_shown():
            if "manifest" not in guest.topics:
                return False
            blob = guest.blob(guest.topics["manifest"]["name"])
            return blob is not None and json.loads(blob)["content_hash"] == wanted
        if not wait_until(is_shown):
            raise AssertionError(f"never shown: {wanted}")
    return time.monotonic() - began


def report(name, figures):
    is_equal = figures["copy_hash"] == figures["content_hash"]
    print(f"{name}: from the receiver's start, guest in {figures['joined_s']:.2f} s, first manifest "
          f"{figures['manifest_s']:.2f} s, whole copy {figures['copy_s']:.2f} s "
          f"({figures['bytes'] / 1e6:.1f} MB, {figures['gone']} times a group was gone); poses' age "
          f"then {figures['age_ms']}, while copying {figures['age_while_copying_ms']}; the "
          f"machine's programs took {figures['cores']:.2f} processors; hash of the copy "
          f"{'as' if is_equal else 'NOT as'} the manifest says", flush=True)
    return [] if is_equal else [f"{name}: the copy is not what the manifest says"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--edge", type=int, default=512, help="of the volume, a multiple of 32")
    parser.add_argument("--rate", type=float, default=20.0, help="edits per second")
    parser.add_argument("--receivers", type=int, default=3, help="that are there before")
    parser.add_argument("--bound", type=float, default=3.0,
                        help="seconds from its start to the first manifest")
    options = parser.parse_args()
    found = []
    with Room(options.receivers, {"volume": "builtin:sphere:16"}, more_sites=2) as room:
        with room.daemon.connect() as conn:
            begin = time.monotonic()
            conn.volume.upload(texture(options.edge), name="texture")
            print(f"palpated has the volume after {time.monotonic() - begin:.1f} s", flush=True)
        began = time.monotonic()
        wanted = hash_of_palpated(room.daemon)
        print(f"palpated's stream of it: {time.monotonic() - began:.1f} s", flush=True)
        for name, gateway in (("the publisher", room.publisher), *(
                (f"receiver {n}", one) for n, one in enumerate(room.receivers))):
            wait_for_hash(gateway, wanted)
            print(f"{name} shows it {time.monotonic() - began:.1f} s after the load", flush=True)
        _, figures = join(room, 3.0)
        found += report("at rest", figures)
        if figures["copy_hash"] != wanted:
            found.append("at rest: the copy is not palpated's volume")
        late = {"at rest": figures["manifest_s"]}
        with Editor(room.daemon, options.rate) as editor:
            receiver, figures = join(room, 3.0)
        print(f"{editor.edits / editor.seconds:.1f} edits/s of {GROUPS_EDITED} groups were made")
        found += report("while edited", figures)
        late["while edited"] = figures["manifest_s"]
        seconds = wait_for_hash(receiver, hash_of_palpated(room.daemon))
        print(f"the last edit is shown {seconds:.2f} s after palpated's own stream had it")
    found += [f"{name}: the first manifest after {seconds:.2f} s" for name, seconds in late.items()
              if seconds > options.bound]
    for line in found:
        print(f"FAILED: {line}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
