"""Filters are exact, one edit, cancelled at once, and felt while others edit."""

import json
import signal
import subprocess
import threading
import unittest

import numpy as np

import palpate
from support import PALPATE, PATIENCE_S, Daemon, DaemonTest

SHAPE = (30, 22, 41)


def mean_of(values, background, width=1):
    """What OpenVDB's mean makes of it: sums in float32, along x, z, y."""
    share = np.float32(1) / np.float32(2 * width + 1)
    result = values.astype(np.float32)
    for axis in (0, 2, 1):
        around = [(width, width) if a == axis else (0, 0) for a in range(3)]
        padded = np.pad(result, around, constant_values=np.float32(background))
        total = np.zeros_like(result)
        for n in range(2 * width + 1):
            total += np.take(padded, range(n, n + result.shape[axis]), axis=axis)
        result = total * share
    return result


class Filters(DaemonTest):
    def setUp(self):
        self.values = np.random.default_rng(5).uniform(-1000, 2000, SHAPE).astype(np.float32)
        self.conn.volume.upload(self.values)
        self.edit = self.conn.edit
        self.low, self.high = self.values.min(), self.values.max()

    def downloaded(self):
        return self.conn.volume.download().values

    def mean(self, width=1):
        return mean_of(self.values, self.low, width).clip(self.low, self.high)

    def test_a_mean_is_exact_and_one_step(self):
        before = self.conn.volume.info().volume_revision
        said = []
        result = self.edit.filter("mean", progress=lambda *event: said.append(event))
        expected = self.mean()
        np.testing.assert_array_equal(self.downloaded(), expected)
        self.assertEqual(result.volume_revision, before + 1)
        self.assertEqual(result.changed_voxels, (expected != self.values).sum())
        self.assertEqual(result.undo_steps, 1)
        self.assertEqual({stage for stage, _ in said}, {"filtering"})
        self.assertEqual(said[0][1], 0.0)
        self.edit.undo()
        np.testing.assert_array_equal(self.downloaded(), self.values)
        self.edit.redo()
        np.testing.assert_array_equal(self.downloaded(), expected)

    def test_a_region_is_all_that_changes(self):
        box = ((3, 4, 5), (10, 4, 8))
        self.edit.filter("mean", 2, box=box, frame="index")
        expected = self.values.copy()
        expected[3:11, 4:5, 5:9] = self.mean(2)[3:11, 4:5, 5:9]
        np.testing.assert_array_equal(self.downloaded(), expected)
        self.edit.undo()
        world = self.conn.volume.info().world_from_index
        center = (world @ (15, 11, 20, 1))[:3]
        self.edit.filter("mean", sphere=(center, 5.2))
        distance = np.linalg.norm(np.moveaxis(np.indices(SHAPE), 0, -1) - (15, 11, 20), axis=-1)
        np.testing.assert_array_equal(self.downloaded(),
                                      np.where(distance <= 5.2, self.mean(), self.values))

    def test_all_kinds_smooth(self):
        noise = self.values.std()
        for kind in ("gaussian", "mean", "median"):
            self.edit.filter(kind, 1, 2)
            self.assertLess(self.downloaded()[4:-4, 4:-4, 4:-4].std(), 0.5 * noise, kind)
            self.edit.undo()

    def test_what_is_refused(self):
        refused = [lambda: self.edit.filter("bilateral"),
                   lambda: self.edit.filter("mean", 0),
                   lambda: self.edit.filter("mean", -1),
                   lambda: self.edit.filter("mean", 9),
                   lambda: self.edit.filter("mean", 1 << 40),
                   lambda: self.edit.filter("mean", 1.5),
                   lambda: self.edit.filter("mean", True),
                   lambda: self.edit.filter("mean", 1, 0),
                   lambda: self.edit.filter("mean", 1, 33),
                   lambda: self.edit.filter("gaussian", 1, 9),
                   lambda: self.edit.filter("mean", box=((9, 9, 9), (3, 10, 10))),
                   lambda: self.edit.filter("mean", box=((1, 1), (3, 3, 3))),
                   lambda: self.edit.filter("mean", sphere=((1, 1, 1), 0)),
                   lambda: self.edit.filter("mean", sphere=((1, 1, np.nan), 3)),
                   lambda: self.edit.filter("mean", sphere=((999, 1, 1), 3)),
                   lambda: self.edit.filter("mean", frame="lps"),
                   lambda: self.edit.filter("mean", box=((1, 1, 1), (3, 3, 3)),
                                            sphere=((1, 1, 1), 3))]
        for n, call in enumerate(refused):
            with self.assertRaises(palpate.InvalidArgument, msg=str(n)) as caught:
                call()
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaises(palpate.Conflict):
            self.edit.filter("mean", expected_revision=1 << 40)
        np.testing.assert_array_equal(self.downloaded(), self.values)

    def command(self, *arguments):
        return [PALPATE, "edit", "filter", *arguments, "--socket", self.daemon.socket]

    def test_the_command(self):
        ran = subprocess.run(self.command("--kind", "mean", "--box-voxels", "2,3,4,12,13,14",
                                          "--json"), capture_output=True, text=True,
                             timeout=PATIENCE_S, check=True)
        said = json.loads(ran.stdout)
        self.assertEqual(said["changed"], {"min": [2, 3, 4], "max": [12, 13, 14]})
        self.assertEqual(said["changed_voxels"], 11**3)
        self.assertEqual(said["undo_steps"], 1)
        self.assertIn("filtering", ran.stderr)
        ran = subprocess.run(self.command("--kind", "mean", "--width", "9"), capture_output=True,
                             text=True, timeout=PATIENCE_S, check=False)
        self.assertEqual(ran.stderr.count("\n"), 1)
        self.assertIn("width 9", ran.stderr)
        self.assertNotEqual(ran.returncode, 0)


class Cancelling(DaemonTest):
    """A filter that takes minutes."""

    volume = "builtin:gyroid:128"

    def setUp(self):
        self.before = self.conn.volume.info().volume_revision

    def check_nothing_changed(self):
        # The next one is not refused: the one before has ended.
        result = self.conn.edit.filter("mean", box=((0, 0, 0), (1, 1, 1)), frame="index")
        self.assertLessEqual(result.volume_revision, self.before + 1)

    def test_an_exception_cancels_and_one_runs_at_a_time(self):
        def stop(_stage, _fraction):
            with self.assertRaises(palpate.Conflict):
                self.conn.edit.filter("mean")
            raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt):
            self.conn.edit.filter("median", 8, progress=stop)
        for _ in range(50):  # the daemon hears of it
            try:
                return self.check_nothing_changed()
            except palpate.Conflict:
                threading.Event().wait(0.1)
        self.fail("the filter still runs")

    def test_the_command_is_cancelled_by_a_signal(self):
        with subprocess.Popen([PALPATE, "edit", "filter", "--kind", "median", "--width", "8",
                               "--socket", self.daemon.socket], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True) as process:
            self.assertIn("filtering", process.stderr.readline())
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=20)
        self.assertEqual(process.returncode, 9, err)
        self.assertEqual(out, "")
        self.assertIn("the filter was cancelled; nothing was changed", err)
        self.assertEqual(self.conn.volume.info().volume_revision, self.before)


class WhileOthersEdit(unittest.TestCase):
    def test_the_hand_is_never_inside_material(self):
        with Daemon("builtin:gyroid:256") as daemon, daemon.connect() as conn:
            loaded = conn.volume.info().volume_revision
            stop = threading.Event()
            samples, edits = [], []

            def watch():
                with conn.poses(rate_hz=1000, batch=50, waiting=1000) as stream:
                    for poses in stream:
                        samples.append(poses)
                        if stop.is_set():
                            return

            def change(seed):
                random = np.random.default_rng(seed)
                with daemon.connect() as other:
                    while not stop.is_set():
                        edits.append(other.edit.sphere(random.uniform(0, 255, 3), 6, "add", 0.3,
                                                       frame="index").changed_voxels > 0)

            threads = [threading.Thread(target=watch)]
            threads += [threading.Thread(target=change, args=(n,)) for n in range(4)]
            for thread in threads:
                thread.start()
            with daemon.connect() as other:
                filtered = other.edit.filter("gaussian")
            stop.set()
            for thread in threads:
                thread.join()
            poses = palpate.Poses.concatenate(samples)
            free = np.isin(poses.mode, [palpate.ProxyMode.FREE, palpate.ProxyMode.CONSTRAINED])
            inside = free & (poses.density > poses.isovalue)
            felt = poses.volume_revision >= filtered.volume_revision
            self.assertGreater(felt.sum(), 0)
            # From one tick on.
            self.assertGreaterEqual(poses.tick[felt].min(), filtered.applied_tick)
            print(f"{len(poses)} samples, {inside.sum()} inside, {len(edits)} edits, "
                  f"{filtered.changed_voxels} voxels filtered, "
                  f"{poses.missed_ticks[-1] - poses.missed_ticks[0]} ticks missed")
            self.assertEqual(inside.sum(), 0)
            self.assertFalse((poses.mode == palpate.ProxyMode.FAULT).any())
            self.assertGreater(len(edits), 4)
            self.assertGreater(filtered.changed_voxels, 10_000_000)
            # Each edit is one revision, and so is the filter.
            self.assertEqual(conn.volume.info().volume_revision, loaded + sum(edits) + 1)

            # download() compares the daemon's content hash.
            before = conn.volume.download().values
            self.assertGreater(conn.edit.filter("gaussian").changed_voxels, 10_000_000)
            conn.edit.undo()
            np.testing.assert_array_equal(conn.volume.download().values, before)


if __name__ == "__main__":
    unittest.main()
