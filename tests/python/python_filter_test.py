"""Filters are exact, one edit, and cancelled at once. While others edit: volume_filterer_test."""

import signal
import subprocess
import unittest

import numpy as np

import palpate
from support import PALPATE, PATIENCE_S, DaemonTest, wait_until

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

    def test_what_is_refused(self):
        around = {"box": ((1, 1, 1), (3, 3, 3)), "sphere": ((1, 1, 1), 3)}
        for arguments, regions in (
                (("bilateral",), {}), (("mean", 1 << 40), {}), (("mean", 1.5), {}),
                (("mean", True), {}), (("mean", 1, 33), {}), (("gaussian", 1, 9), {}),
                (("mean",), {"box": ((1, 1), (3, 3, 3))}),
                (("mean",), {"sphere": ((1, 1, np.nan), 3)}),
                (("mean",), {"sphere": ((999, 1, 1), 3)}), (("mean",), {"frame": "lps"}),
                (("mean",), around)):
            with self.assertRaises(palpate.InvalidArgument, msg=str(arguments)) as caught:
                self.edit.filter(*arguments, **regions)
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaises(palpate.Conflict):
            self.edit.filter("mean", expected_revision=1 << 40)
        np.testing.assert_array_equal(self.downloaded(), self.values)

    def test_all_kinds_smooth(self):
        noise = self.values.std()
        for kind in ("gaussian", "mean", "median"):
            self.edit.filter(kind, 1, 2)
            self.assertLess(self.downloaded()[4:-4, 4:-4, 4:-4].std(), 0.5 * noise, kind)
            self.edit.undo()


class Cancelling(DaemonTest):
    """A filter that takes minutes."""

    volume = "builtin:gyroid:128"

    def setUp(self):
        self.before = self.conn.volume.info().volume_revision

    def check_nothing_changed(self):
        """And the next one is not refused, once the daemon has heard of it."""
        def filtered():
            try:
                self.revision = self.conn.edit.filter(
                    "mean", box=((0, 0, 0), (1, 1, 1)), frame="index").volume_revision
            except palpate.Conflict:
                return False
            return True

        self.assertTrue(wait_until(filtered))
        self.assertLessEqual(self.revision, self.before + 1)

    def test_an_exception_cancels_and_one_runs_at_a_time(self):
        def stop(_stage, _fraction):
            with self.assertRaises(palpate.Conflict):
                self.conn.edit.filter("mean")
            raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt):
            self.conn.edit.filter("median", 8, progress=stop)
        self.check_nothing_changed()

    def test_the_command_is_cancelled_by_a_signal(self):
        with subprocess.Popen([PALPATE, "edit", "filter", "--kind", "median", "--width", "8",
                               "--socket", self.daemon.socket], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True) as process:
            self.assertIn("filtering", process.stderr.readline())
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE_S)
        self.assertEqual((process.returncode, out), (9, ""), err)
        self.check_nothing_changed()


if __name__ == "__main__":
    unittest.main()
