"""Filters as calls: what is asked for is what is filtered, as one edit. What filters compute:
filter_test; while others edit: volume_filterer_test; progress and cancelling: python_reach_test."""

import unittest

import numpy as np

import palpate
from support import DaemonTest

SHAPE = (30, 22, 41)
PLACE = (15, 11, 20)
IMPULSE = 3375.0


class Filters(DaemonTest):
    def setUp(self):
        self.values = np.zeros(SHAPE, np.float32)
        self.values[PLACE] = IMPULSE
        self.conn.volume.upload(self.values, discard_edits=True)
        self.edit = self.conn.edit

    def downloaded(self):
        return self.conn.volume.download().values

    def mean(self, width):
        """Of the impulse: the same in each voxel of a cube."""
        cube = np.abs(np.moveaxis(np.indices(SHAPE), 0, -1) - PLACE).max(axis=-1) <= width
        return np.where(cube, np.float32(IMPULSE / (2 * width + 1)**3), np.float32(0))

    def test_kind_width_and_iterations(self):
        # A gaussian is four means.
        for arguments, edge in ((("mean",), 3), (("mean", 2), 5), (("mean", 1, 2), 5),
                                (("gaussian",), 9), (("gaussian", 1, 2), 17), (("median",), 1)):
            with self.subTest(arguments):
                before = self.conn.volume.info().volume_revision
                result = self.edit.filter(*arguments)
                filtered = self.downloaded()
                self.assertEqual(result.volume_revision, before + 1)
                self.assertEqual((result.undo_steps, result.changed_voxels), (1, edge**3))
                self.assertEqual(np.count_nonzero(filtered), edge**3 if edge > 1 else 0)
                if arguments[0] == "mean" and len(arguments) < 3:
                    np.testing.assert_allclose(filtered, self.mean(edge // 2), rtol=1e-6)
                self.edit.undo()
                np.testing.assert_array_equal(self.downloaded(), self.values)

    def test_a_region_is_all_that_changes(self):
        self.edit.filter("mean", 2, box=((13, 9, 20), (15, 11, 21)), frame="index")
        expected = self.values.copy()
        expected[13:16, 9:12, 20:22] = self.mean(2)[13:16, 9:12, 20:22]
        np.testing.assert_allclose(self.downloaded(), expected, rtol=1e-6)
        self.edit.undo()
        center = (self.conn.volume.info().world_from_index @ (*PLACE, 1))[:3]
        self.edit.filter("mean", sphere=(center, 1.2))
        distance = np.linalg.norm(np.moveaxis(np.indices(SHAPE), 0, -1) - PLACE, axis=-1)
        np.testing.assert_allclose(self.downloaded(),
                                   np.where(distance <= 1.2, self.mean(1), self.values), rtol=1e-6)

    def test_what_is_refused(self):
        around = {"box": ((1, 1, 1), (3, 3, 3)), "sphere": ((1, 1, 1), 3)}
        for arguments, regions in (
                (("bilateral",), {}), (("mean", 1 << 40), {}), (("mean", 1.5), {}),
                (("mean", True), {}), (("mean", 1, 33), {}), (("gaussian", 1, 9), {}),
                (("mean",), {"box": ((1, 1), (3, 3, 3))}),
                (("mean",), {"sphere": ((1, 1, np.nan), 3)}),
                (("mean",), {"sphere": ((999, 1, 1), 3)}), (("mean",), {"frame": "lps"}),
                (("mean",), {"box": (1, 2, 3)}), (("mean",), {"sphere": 5}), (("mean", -1), {}),
                (("resample",), {"spacing_mm": True}), (("mean",), around)):
            with self.assertRaises(palpate.InvalidArgument, msg=str(arguments)) as caught:
                self.edit.filter(*arguments, **regions)
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaises(palpate.Conflict):
            self.edit.filter("mean", expected_revision=1 << 40)
        np.testing.assert_array_equal(self.downloaded(), self.values)


if __name__ == "__main__":
    unittest.main()
