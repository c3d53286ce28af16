"""Kills at random in a room on NATS, and what guests are shown: palpated, the publishing palpate-web,
nats-server, a leaf server of it and two receiving palpate-webs, one at each server, are killed
(SIGKILL), one or several at once, and each is started again after a random pause. Now and then
palpated's volume is edited meanwhile.

- Within BACK_S of the last start, without a hand, a guest of each gateway is there again: it is told
  "connected", gets new poses that are fresh, and is shown palpated's volume.
- No guest is ever shown a volume that never was. The script makes all edits, and computes the
  content hash of each state itself; each manifest that a guest is told of is fetched with all its
  groups, and the hash of those voxels must be one of them and that of the manifest.

The seed says which kills: --seed of a run that failed repeats its order, not its times."""

import argparse
import http.client
import json
import random
import signal
import sys
import threading
import time

import numpy as np

import crash
import palpate
from free_port import free_port
from gateway import Copy, Guest
from nats import NatsServer
from room import Room, content_hash, hash_of_palpated, hub_config, leaf_config
from support import PATIENCE_S, Daemon

EDGE = 64
VOLUME = f"builtin:bumps:{EDGE}"
BACK_S = 5.0


class States:
    """Every state that palpated's volume had, by content hash: it is the `base` at each start."""

    def __init__(self, base):
        self._base = base
        self.base_hash = content_hash(base)
        self.hashes = {self.base_hash}
        self.forget()

    def forget(self):
        """palpated was killed: edits are lost."""
        self._now, self.now_hash = self._base.copy(), self.base_hash

    def edit(self, call, rng, may_begin):
        """A block at random. The new state counts from before it is asked for. False: it may not
        begin any more."""
        first = tuple(rng.randrange(EDGE - 12) for _ in range(3))
        block = np.full([rng.randrange(1, 12) for _ in range(3)], np.float32(rng.random()))
        changed = self._now.copy()
        changed[tuple(slice(at, at + length) for at, length in zip(first, block.shape))] = block
        new_hash = content_hash(changed)
        self.hashes.add(new_hash)
        if not may_begin():
            return False
        call(first, block)
        self._now, self.now_hash = changed, new_hash
        return True


class Follower:
    """A guest who comes back: as a page does, it joins anew when its connection is lost. Copies what
    it is shown, and judges it."""

    def __init__(self, name, gateway, states):
        self.name, self.shown, self.wrong, self.judged, self.joins = name, None, [], 0, 0
        self.guest = None
        self._gateway, self._states, self._over = gateway, states, threading.Event()
        self._groups, self._pending = {}, []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._over.is_set():
            try:
                with Guest(self._gateway) as guest:
                    self.joins += 1
                    self.shown, self.guest = None, guest
                    self._follow(guest)
            except (OSError, RuntimeError, EOFError, http.client.HTTPException):
                pass  # it is down, or goes
            except Exception as error:  # whatever it is, it is the result
                self.wrong.append(f"{self.name}: {error!r}")
            self.guest = None
            self._over.wait(0.1)

    def _follow(self, guest):
        seen = 0
        while guest.is_open and not self._over.is_set():
            if seen < len(guest.manifests):
                seen = len(guest.manifests)
                self._judge(guest, guest.manifests[seen - 1])
            self._over.wait(0.02)

    def _judge(self, guest, name):
        blob = guest.blob(name)
        if blob is None:
            return  # superseded: a newer one comes
        manifest = json.loads(blob)
        if len(self._groups) > 5000:
            self._groups.clear()
        copy = Copy(guest, manifest, self._groups)
        if copy.lost:
            return
        is_hash, said = content_hash(copy.voxels), manifest["content_hash"]
        if is_hash != said:
            self.wrong.append(f"{self.name}: {name} is {is_hash}, and says {said}")
        if is_hash not in self._states.hashes:
            self.wrong.append(f"{self.name}: {name} is {is_hash}, which never was")
        self.judged += 1
        self.shown = is_hash

    def problem(self, since_s):
        """Why it is not back since that time; none: it is."""
        guest = self.guest
        if guest is None or not guest.is_open:
            return "not joined"
        connection = guest.topics.get("connection", {})
        if connection.get("state") != "connected":
            return f"connection {connection}"
        pose = guest.pose
        if pose is None or not pose.fresh:
            return "no fresh pose"
        time_s = 1e-9 * pose.pose.time_ns
        if time_s < max(since_s, time.monotonic() - 0.5):
            return f"its newest pose is {time.monotonic() - time_s:.1f} s old"
        if self.shown != self._states.now_hash:
            return f"shows {self.shown}, not {self._states.now_hash}"
        return None

    def stop(self):
        self._over.set()
        self._thread.join(PATIENCE_S)


def kill(program):
    """A Daemon, Gateway or NatsServer; the last lines of its log."""
    if isinstance(program, Daemon):
        program.end(signal.SIGKILL)
    elif isinstance(program, NatsServer):
        program.kill()
    else:
        program.process.kill()
        program.end()
    return program.said[-20:]


class Kills:
    def __init__(self, room, leaf, seed):
        self.room, self._rng = room, random.Random(seed)
        with room.daemon.connect() as conn:
            base = np.array(conn.volume.download().values)
        self.states = States(base)
        if self.states.base_hash != hash_of_palpated(room.daemon):
            raise RuntimeError("the script's content hash is not palpated's")
        gateways = [("publisher", room.publisher)] + [
            (f"receiver {n}", gateway) for n, gateway in enumerate(room.receivers)]
        self.followers = [Follower(name, gateway, self.states) for name, gateway in gateways]
        self.programs = {"palpated": room.daemon, "nats-server": room.nats,
                         "leaf server": leaf} | dict(gateways)
        self.kills, self.edits = {name: 0 for name in self.programs}, 0
        self.back_s, self.found, self.said, self._starts_s = [], [], [], []
        self._edited_s = 0.0

    def wait_until_back(self, since_s, what, patience_s=60.0):
        """Seconds from `since_s`, a time."""
        while True:
            problems = {one.name: one.problem(since_s) for one in self.followers}
            problems = {name: why for name, why in problems.items() if why}
            now_s = time.monotonic()
            if not problems:
                return now_s - since_s
            if now_s - since_s > patience_s:
                self.found.append(f"{what}: not back after {patience_s:.0f} s: {problems}")
                self.show_logs()
                return now_s - since_s
            time.sleep(0.01)

    def _edit(self, until_s):
        """A few changes, until then, or until palpated is killed."""
        starts = self.kills["palpated"]

        def is_same():
            return self.kills["palpated"] == starts

        try:
            with self.room.daemon.connect() as conn:
                while time.monotonic() < until_s and self.states.edit(conn.edit.block, self._rng,
                                                                      is_same):
                    self.edits += 1
                    self._edited_s = time.monotonic()
                    time.sleep(self._rng.uniform(0.0, 0.1))
        except palpate.Error as error:
            if is_same():
                self.found.append(f"an edit: {error}")

    def round(self, most):
        """Kills up to `most` programs, and waits until all are back."""
        rng = self._rng
        names = rng.sample(list(self.programs), min(most, rng.choice([1, 1, 1, 2, 2, 3, 6])))
        threads = [threading.Thread(target=self._kill_and_start, args=(
            name, rng.uniform(0.0, 0.6), rng.choice([0.0, 0.2, 1.0, 2.5, 4.0]) * rng.random()))
            for name in names]
        is_edited = rng.random() < 0.4
        if is_edited:
            threads.append(threading.Thread(target=self._edit, args=(time.monotonic() + 1.5,)))
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE_S)
        if "palpated" in names:
            self.states.forget()
        what = ", ".join(names) + (" while edited" if is_edited else "")
        last_s = max([self._edited_s, *self._starts_s[-len(names):]])
        seconds = self.wait_until_back(last_s, what)
        self.back_s.append(seconds)
        if seconds > BACK_S:
            self.found.append(f"back {seconds:.1f} s after the last start, of {what}")
        print(f"{sum(self.kills.values())} kills: {what}: back after {seconds:.2f} s"
              + (" LATE" if seconds > BACK_S else ""), flush=True)

    def _kill_and_start(self, name, before_s, pause_s):
        time.sleep(before_s)
        self.kills[name] += 1
        self.said.append((name, kill(self.programs[name])))
        time.sleep(pause_s)
        self._starts_s.append(time.monotonic())
        self.programs[name].start()

    def stop(self):
        for follower in self.followers:
            follower.stop()
            self.found += follower.wrong
            print(f"{follower.name}: {follower.joins} joins, {follower.judged} manifests judged, "
                  f"{len(follower.wrong)} wrong")
            if not follower.judged:
                self.found.append(f"{follower.name}: no manifest was judged")

    def show_logs(self):
        for name, program in self.programs.items():
            print(f"--- {name}\n" + "".join(program.said[-15:]), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100, help="in all [100]")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    port = free_port()
    with Room(1, {"volume": VOLUME}, server=lambda room: hub_config(room, port)) as room, \
            NatsServer(leaf_config("127.0.0.1", port, room.sites[1])) as leaf:
        room.receive(leaf)
        kills = Kills(room, leaf, options.seed)
        try:
            kills.wait_until_back(time.monotonic(), "the start")
            while (left := options.kills - sum(kills.kills.values())) > 0 and len(kills.found) < 10:
                kills.round(left)
        finally:
            kills.stop()
    found = kills.found + crash.found
    print(f"{kills.kills}, {kills.edits} edits, {len(kills.states.hashes)} states; back after p50 "
          f"{sorted(kills.back_s)[len(kills.back_s) // 2]:.2f} s, at most "
          f"{max(kills.back_s):.2f} s")
    for line in found:
        print(f"FAILED: {line}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
