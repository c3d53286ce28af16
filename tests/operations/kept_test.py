"""What palpated answered is on the disk, or the answer says that it is not: palpated is killed, or ended in
order, right after its answers, also while the disk under its state is full."""

import contextlib
import gzip
import itertools
import random
import re
import resource
import signal
import threading
import unittest
import warnings

import numpy as np

import palpate
from support import PATIENCE_S, Daemon, nrrd, wait_until

# Below it are only the eight bytes that count the edits.
FULL_BYTES = 16
TOOL = palpate.Tool((palpate.ToolBall((0, 0, 0), 1.0), palpate.ToolBall((0, 0, 5), 2.0)), "rod")
KILLS = 60


def fill_disk(daemon):
    """As if the disk were full, from now on: no file may grow."""
    resource.prlimit(daemon.pid, resource.RLIMIT_FSIZE, (FULL_BYTES, resource.RLIM_INFINITY))


def told(call):
    """Calls it. Returns what says that its change is not kept; "": nothing does."""
    try:
        return getattr(call(), "not_kept", "")
    except palpate.Error as refused:
        return f"refused: {refused}"


def setUpModule():
    # They are errors where tests run, and the answers say the same.
    warnings.filterwarnings("ignore", "not kept", RuntimeWarning)


class EachAnswer(unittest.TestCase):
    def setUp(self):
        self.daemon = self.enterContext(Daemon("builtin:gyroid:32"))
        self.folder = self.daemon.folder
        self.volume = self.folder / "other.nrrd"
        ball = np.linalg.norm(np.indices((24,) * 3) - 11.5, axis=0).astype(np.float32)
        self.volume.write_bytes(nrrd(ball))
        self.frames = [self.volume, self.folder / "second.nrrd"]
        self.frames[1].write_bytes(nrrd(ball + 1.0))

    def answers(self):
        """By name: what to call, and whether a later palpated has it, or tells that it has not."""
        def setting(**changes):
            return (lambda c: c.settings.update(**changes),
                    lambda c: all(c.settings.all()[name] == value
                                  for name, value in changes.items()))

        def says(text):
            return lambda c: any(text in line for line in c.volume.info().warnings)

        def recorded(c):
            c.recording.start(self.folder / "a.mcap")
            c.recording.stop()

        return {
            "settings": setting(stiffness_n_per_mm=0.75, isovalue=0.4),
            "layers": setting(layers=(palpate.Layer("skin", 0.4, 0.25, id=1),)),
            "ball": setting(tool_radius_mm=1.5), "tool": setting(tool=TOOL),
            "place": (lambda c: c.volume.place(center_mm=(3, 4, 5)),
                      lambda c: np.allclose(c.volume.place().center_mm, (3, 4, 5))),
            "facing": (lambda c: c.volume.place(face="-y", head="+z"),
                       lambda c: c.volume.info().patient_axes_answered),
            "load": (lambda c: c.volume.load(self.volume, device_mm_per_volume_mm=1.25),
                     lambda c: (c.volume.info().source == str(self.volume) and
                                c.volume.place().device_mm_per_volume_mm == 1.25)),
            "series": (lambda c: c.series.load(self.frames), says("loaded again by clients")),
            "upload": (lambda c: c.volume.upload(np.arange(729, dtype=np.uint16).reshape(9, 9, 9)),
                       says("loaded again by clients")),
            "edit": (lambda c: c.edit.sphere((0, 0, 0), 4, "set", 0.5), says("lost: 1")),
            "undo": (lambda c: (c.edit.sphere((0, 0, 0), 4, "set", 0.5), c.edit.undo()),
                     lambda c: not says("lost")(c)),
            "save": (lambda c: c.volume.save(self.folder / "saved.nrrd"),
                     lambda c: c.volume.load(self.folder / "saved.nrrd").shape == (32, 32, 32)),
            "recording": (recorded,
                          lambda _: palpate.open_recording(self.folder / "a.mcap").complete),
        }

    def test_is_kept_or_says_that_it_is_not(self):
        for name, number, is_full in itertools.product(
                self.answers(), (signal.SIGKILL, signal.SIGTERM), (False, True)):
            with self.subTest(answer=name, signal=number, full=is_full):
                call, is_kept = self.answers()[name]
                self.daemon.end(signal.SIGKILL)
                for left in [*(self.folder / "state").glob("**/*.toml*"),
                             *self.folder.glob("saved*"), *self.folder.glob("*.mcap")]:
                    left.unlink()
                self.daemon.start()
                with self.daemon.connect() as conn:
                    if is_full:
                        # The session as it was at the start comes first.
                        sessions = self.folder / "state" / "sessions"
                        self.assertTrue(wait_until(lambda: list(sessions.glob("*.toml"))))
                        fill_disk(self.daemon)
                    said = told(lambda: call(conn))
                    if not said.startswith("refused"):
                        said += " ".join(line for line in conn.volume.info().warnings
                                         if "not kept" in line)
                        self.assertEqual(wait_until(lambda: next(conn.facts()).not_kept,
                                                    PATIENCE_S if said else 0), bool(said))
                    self.assertTrue(is_full or not said, said)
                    self.daemon.end(number)
                self.daemon.start()
                with self.daemon.connect() as conn:
                    self.assertTrue(said or is_kept(conn), conn.volume.info().warnings)

    def test_a_full_disk_is_told_to_all_until_there_is_room(self):
        with self.daemon.connect() as conn, self.daemon.connect() as other:
            fill_disk(self.daemon)
            self.assertIn("not kept", self.daemon.palpate("set", "stiffness_n_per_mm", 0.8).stderr)
            self.assertIn("not kept", self.daemon.palpate("place", "--move-mm", "1,0,0").stderr)

            def warned():
                return [line for line in other.volume.info().warnings if "not kept" in line]
            self.assertEqual(len(warned()), 2)
            facts = other.facts()
            self.assertTrue(next(one for one in facts if one.not_kept).not_kept)
            self.assertEqual(conn.settings.stiffness_n_per_mm, 0.8)
            resource.prlimit(self.daemon.pid, resource.RLIMIT_FSIZE,
                             (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            self.assertTrue(wait_until(lambda: not warned()))
            self.assertFalse(next(one for one in facts if not one.not_kept).not_kept)


class Kills(unittest.TestCase):
    """At random moments, over all that is kept, the disk full in half of them."""

    def test_lose_nothing_that_was_answered_as_kept(self):
        chance = random.Random(90)
        with Daemon("builtin:gyroid:32") as daemon:
            for n in range(KILLS):
                with self.subTest(kill=n):
                    self.kill_once(daemon, chance, n)

    def kill_once(self, daemon, chance, n):
        # Of each thing what may be there later: the last that was kept, and all asked for since.
        stiffness, center, edits, files, uploads = [], [], [0], [], []
        done = threading.Event()

        def keep(candidates, value, call):
            candidates.append(value)
            if not told(call) and not done.is_set():
                del candidates[:candidates.index(value)]

        def settings(conn):
            value = round(chance.uniform(0.1, 2.0), 6)
            keep(stiffness, value, lambda: conn.settings.update(stiffness_n_per_mm=value))

        def place(conn):
            value = tuple(round(chance.uniform(-9, 9), 6) for _ in range(3))
            keep(center, value, lambda: conn.volume.place(center_mm=value))

        def edit(conn):
            at = tuple(chance.uniform(4, 27) for _ in range(3))
            value = edits[-1] + 1
            keep(edits, value,
                 lambda: conn.edit.sphere(at, 2.0, "set", chance.uniform(0.4, 0.6), frame="index"))

        def save(conn):
            path = daemon.folder / f"{n}-{len(files)}.nrrd"
            if not told(lambda: conn.volume.save(path)):
                files.append(path)

        def record(conn):
            path = daemon.folder / f"{n}-{len(files)}.mcap"
            conn.recording.start(path)
            if not conn.recording.stop().error:
                files.append(path)

        def upload(conn):
            conn.volume.upload(np.arange(729, dtype=np.uint16).reshape(9, 9, 9), discard_edits=True)
            uploads.append(conn.volume.info().warnings)

        def work(call):
            with daemon.connect() as conn:
                while not done.is_set():
                    with contextlib.suppress(palpate.Error):
                        call(conn)

        calls = [settings, *[(place,), (edit,), (save, record), (upload,)][n % 4]]
        with daemon.connect() as conn:
            stiffness.append(conn.settings.stiffness_n_per_mm)
            center.append(tuple(conn.volume.place().center_mm))
        threads = [threading.Thread(target=work, args=(call,)) for call in calls]
        for thread in threads:
            thread.start()
        done.wait(chance.uniform(0.05, 0.5))
        if n % 8 >= 4:
            fill_disk(daemon)
            done.wait(chance.uniform(0.0, 0.3))
        daemon.end(chance.choice((signal.SIGKILL, signal.SIGKILL, signal.SIGTERM)))
        done.set()
        for thread in threads:
            thread.join(PATIENCE_S)
        daemon.start()
        with daemon.connect() as conn:
            self.assertIn(conn.settings.stiffness_n_per_mm, stiffness)
            said = " ".join(conn.volume.info().warnings)
            if uploads and not any("not kept" in line for line in uploads[-1]):
                self.assertIn("loaded again by clients", said)
            elif not uploads:
                now = conn.volume.place().center_mm
                self.assertTrue(any(np.allclose(now, one) for one in center), (now, center))
            lost = re.search(r"lost: (\d+)", said)
            self.assertIn(int(lost[1]) if lost else 0, edits)
        for path in files:
            if path.suffix == ".mcap":
                self.assertTrue(palpate.open_recording(path).complete)
            else:
                voxels = gzip.decompress(path.read_bytes().partition(b"\n\n")[2])
                self.assertEqual(len(voxels), 4 * 32**3)
        for path in daemon.folder.glob(f"{n}-*"):
            path.unlink()
        # Else the second kill within a minute gives the session up.
        daemon.end()
        daemon.start()


if __name__ == "__main__":
    unittest.main()
