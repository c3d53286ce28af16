"""Edits change the voxels that they say, exactly, and no others."""

import json
import unittest

import numpy as np

import palpate
from support import DaemonTest, pattern

SHAPE = (30, 22, 41)
SPACING_MM = np.array([0.5, 2.0, 1.0])


class EditsTest(DaemonTest):
    def setUp(self):
        self.values = pattern(SHAPE)
        self.conn.volume.upload(self.values, SPACING_MM, discard_edits=True)
        self.edit = self.conn.edit

    def check(self, result, expected):
        volume = self.conn.volume.download()
        np.testing.assert_array_equal(volume.values, expected)
        self.assertEqual(volume.volume_revision, result.volume_revision)
        changed = np.argwhere(expected != self.values)
        self.assertEqual(result.changed_voxels, len(changed))
        box = tuple(slice(low, high + 1)
                    for low, high in zip(changed.min(axis=0), changed.max(axis=0)))
        self.assertEqual(result.changed, box)

    def distance(self, center, unit):
        places = np.moveaxis(np.indices(SHAPE), 0, -1)
        return np.linalg.norm((places - center) * unit, axis=-1)

    def test_shapes(self):
        center, center_mm = (7, 11, 30), np.array([7.1, 20.3, 25.2])
        along = np.clip(np.arange(SHAPE[2]), 5, 25)
        i, j, k = np.indices(SHAPE)
        in_capsule = np.sqrt((i - 5.0)**2 + (j - 5.0)**2 + (k - along[k])**2) <= 2.5
        in_box, in_box_mm, in_block = (np.zeros(SHAPE, bool) for _ in range(3))
        in_box[3:11, 4:5, 5:9] = in_box_mm[6:13, 3:5, 5:9] = in_block[20:24, 10:13, 30:39] = True
        block = pattern((4, 3, 9)) + 7
        written = np.zeros(SHAPE, np.float32)
        written[in_block] = block.ravel()
        edit = self.edit
        for name, inside, new, make in (
                ("sphere in voxels", self.distance(center, 1) <= 4.3, 5000.0,
                 lambda: edit.sphere(center, 4.3, "set", 5000.0, frame="index")),
                ("sphere in mm", self.distance(center_mm / SPACING_MM, SPACING_MM) <= 5.15, 5000.0,
                 lambda: edit.sphere(center_mm, 5.15, "set", 5000.0)),
                ("box", in_box, 1234.0,
                 lambda: edit.box((3, 4, 5), (10, 4, 8), "set", 1234.0, frame="index")),
                ("box in mm", in_box_mm, self.values - 128.0,
                 lambda: edit.box((2.6, 5.0, 4.5), (6.4, 9.0, 8.5), "subtract", 128.0)),
                ("capsule", in_capsule, self.values + 64.0,
                 lambda: edit.capsule((5.0, 5, 5), (5.0, 5, 25), 2.5, "add", 64.0, frame="index")),
                ("block", in_block, written, lambda: edit.block((20, 10, 30), block))):
            with self.subTest(name):
                result = make()
                self.check(result, np.where(inside, new, self.values))
                edit.undo()
        # What changed is an index into the array.
        np.testing.assert_array_equal(written[result.changed], block)

    def test_undo_redo_and_revert(self):
        first = self.edit.box((0, 0, 0), (5, 5, 5), "set", 99.0, frame="index")
        edited = self.conn.volume.download().values
        for call, expected, steps in ((self.edit.undo, self.values, (0, 1)),
                                      (self.edit.redo, edited, (1, 0)),
                                      (self.edit.revert, self.values, (2, 0))):
            result = call()
            self.assertEqual((result.undo_steps, result.redo_steps), steps)
            self.assertEqual(result.changed, first.changed)
            np.testing.assert_array_equal(self.conn.volume.download().values, expected)
        with self.assertRaises(palpate.Conflict):
            self.edit.redo()

    def test_smooth_paint_and_falloff_change_something(self):
        # Smoothing last: the pattern is linear, and equals its mean.
        for call in (lambda: self.edit.sphere((9, 9, 9), 3, "paint", 7.0, frame="index"),
                     lambda: self.edit.sphere((9, 9, 9), 3, "add", 7.0, frame="index", falloff=2),
                     lambda: self.edit.sphere((9, 9, 9), 3, "smooth", frame="index",
                                              strength=0.5)):
            self.assertGreater(call().changed_voxels, 100)

    def test_edits_are_not_lost_without_a_word(self):
        conn, daemon = self.conn, self.daemon

        def unsaved():
            shown = json.loads(daemon.palpate("info", "--json").stdout)["volume"]["unsaved_edits"]
            self.assertEqual(shown, conn.volume.info().unsaved_edits)
            return shown
        self.assertEqual(unsaved(), 0)
        self.edit.sphere((5, 5, 5), 2, "set", 5000.0, frame="index")
        self.assertEqual(unsaved(), 1)
        self.assertIn("1 edit is not saved", daemon.palpate("info").stdout)
        before = conn.volume.info().volume_revision
        for load in (lambda: conn.volume.load("builtin:sphere:16"),
                     lambda: conn.volume.upload(self.values),
                     lambda: conn.series.load("builtin:sphere:16")):
            with self.assertRaises(palpate.FailedPrecondition):
                load()
        daemon.palpate("load", "builtin:sphere:16", code=10)
        self.assertEqual(conn.volume.info().volume_revision, before)
        conn.volume.save(daemon.folder / "edited.nrrd")
        self.assertEqual(unsaved(), 0)
        daemon.palpate("load", "builtin:sphere:16")
        self.edit.sphere((5, 5, 5), 2, "set", 0.9, frame="index")
        daemon.palpate("load", "builtin:sphere:32", "--discard")
        self.edit.sphere((5, 5, 5), 2, "set", 0.9, frame="index")
        loaded = conn.volume.load("builtin:sphere:16", discard_edits=True)
        self.assertEqual(loaded.unsaved_edits, 0)
        self.assertEqual(unsaved(), 0)

    def test_nothing_changed(self):
        before = self.conn.volume.info().volume_revision
        result = self.edit.block((3, 3, 3), self.values[3:5, 3:5, 3:5])
        self.assertEqual((result.changed_voxels, result.changed, result.volume_revision),
                         (0, None, before))

    def test_a_value_is_there_where_it_is_used(self):
        shapes = (lambda *how: self.edit.sphere((9, 9, 9), 3, *how, frame="index"),
                  lambda *how: self.edit.box((3, 3, 3), (9, 9, 9), *how, frame="index"),
                  lambda *how: self.edit.capsule((9, 9, 9), (9, 9, 15), 3, *how, frame="index"))
        for shape in shapes:
            for operation in ("add", "subtract", "set", "paint"):
                with self.assertRaisesRegex(palpate.InvalidArgument, f"value.*'{operation}'"):
                    shape(operation)
            with self.assertRaisesRegex(palpate.InvalidArgument, "value.*'smooth'"):
                shape("smooth", 1.0)
        np.testing.assert_array_equal(self.conn.volume.download().values, self.values)
        # Zero is one.
        self.assertGreater(shapes[0]("set", 0).changed_voxels, 50)

    def test_what_is_refused(self):
        block, sphere = np.zeros((2, 2, 2)), self.edit.sphere
        refused = [lambda: sphere((1, 1), 3, "set", 1.0),
                   lambda: sphere((1, 1, 1), -3, "set", 1.0),
                   lambda: sphere((1, 1, 1), 3, "erase", 1.0),
                   lambda: sphere((1, 1, 1), 3, "set", 1.0, frame="lps"),
                   lambda: sphere((1, 1, 1), 3, "set", True),
                   lambda: sphere((1, 1, 1), "3", "set", 1.0),
                   lambda: sphere((1, 1, 1), 3, "set", 1.0, falloff=None),
                   lambda: sphere((1, 1, 1), 3, "paint", 1.0, strength=True),
                   lambda: self.edit.block((1, 1, 1), block, "smooth"),
                   lambda: self.edit.block((29, 1, 1), block),
                   lambda: self.edit.block((-1, 1, 1), block),
                   lambda: self.edit.block((1, 1, 1), block[0]),
                   lambda: self.edit.block((1, 1), block),
                   lambda: self.edit.block(1, block),
                   lambda: self.edit.block((1.5, 1, 1), block),
                   lambda: self.edit.block((1 << 40, 1, 1), block),
                   lambda: self.edit.block((1, 1, 1), [[["a"]]]),
                   lambda: sphere("abc", 3, "set", 1.0),
                   lambda: sphere((1, 1, 1), 3, ["set"], 1.0),
                   lambda: self.edit.undo(-1),
                   lambda: self.edit.redo("3"),
                   lambda: self.edit.revert(True),
                   lambda: self.edit.block((1, 1, 1), np.zeros((0, 1, 1)))]
        for n, call in enumerate(refused):
            with self.assertRaises(palpate.InvalidArgument, msg=str(n)) as caught:
                call()
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaises(palpate.TooLarge):
            self.edit.block((0, 0, 0), np.zeros((100, 100, 100)))
        with self.assertRaises(palpate.Conflict):
            self.edit.block((0, 0, 0), block, expected_revision=1 << 40)
        np.testing.assert_array_equal(self.conn.volume.download().values, self.values)


if __name__ == "__main__":
    unittest.main()
