"""Filters of whole volumes through the real daemon: offsets and smoothing of level sets, and
resampling. vdb_tool writes the files and judges what comes back."""

import pathlib
import subprocess

import numpy as np

import palpate
from sparse_support import CENTER, RADIUS_MM, SPHERE_MM, SparseTest, command
from support import PALPATED, PATIENCE_S
from vdb_support import vdb_values

USAGE = 2


class LevelSets(SparseTest):
    def setUp(self):
        super().setUp()
        self.path = self.make("sphere")
        self.load(self.path, "--device-mm-per-volume-mm", "0.9")
        self.conn.settings.update(isovalue=0.0, free_side="above")

    def surface_mm(self, direction):
        """Where the saved file's values change their sign, from the centre of the sphere on."""
        path = self.saved()
        steps = np.arange(0, 60)
        places = np.unique((CENTER + np.outer(steps, direction)).round().astype(int), axis=0)
        places = places[np.argsort(np.linalg.norm(places - CENTER, axis=1))]
        values = np.array([value for value, _ in vdb_values(path, places)], dtype=float)
        crossing = int(np.argmax(values > 0))
        # Distances: no need to go between voxels.
        return SPHERE_MM * np.linalg.norm(places[crossing] - CENTER) - values[crossing]

    def test_an_offset_is_felt_and_taken_back(self):
        before = self.conn.volume.info()
        self.palpate("edit", "filter", "--kind", "offset", "--distance-mm", "4")
        after = self.conn.volume.info()
        self.assertGreater(after.shape[0], before.shape[0])
        self.assertEqual(self.conn.settings.isovalue, 0.0)
        for direction in np.eye(3):
            self.assertAlmostEqual(self.surface_mm(direction), RADIUS_MM + 4, delta=0.1)
        self.require_felt(RADIUS_MM + 4)
        self.palpate("edit", "filter", "--kind", "offset", "--distance-mm", "-5")
        self.require_felt(RADIUS_MM - 1)
        self.palpate("undo")
        self.palpate("undo")
        self.require_equal(self.path, self.saved())
        self.palpate("redo")
        self.require_felt(RADIUS_MM + 4)

    def test_mean_curvature_smooths_what_was_carved(self):
        # A pit of some voxels, which becomes shallow.
        pit = CENTER + np.array((RADIUS_MM / SPHERE_MM - 1, 0, 0))
        self.conn.edit.sphere(tuple(SPHERE_MM * pit), 0.8, "set", 1.5)
        voxel = tuple((pit - self.first_index(self.conn.volume.info(), self.path)).round()
                      .astype(int))
        carved = self.conn.volume.download().values
        self.assertEqual(carved[voxel], 1.5)
        result = self.conn.edit.filter("mean-curvature", iterations=5)
        self.assertGreater(result.changed_voxels, 1000)
        self.assertEqual(self.conn.volume.info().volume_revision, result.volume_revision)
        self.assertLess(self.conn.volume.download().values[voxel], 1.0)
        self.conn.edit.undo()
        np.testing.assert_array_equal(self.conn.volume.download().values, carved)

    def test_a_coarser_level_set_is_the_same_sphere(self):
        self.palpate("edit", "filter", "--kind", "resample", "--spacing-mm", "0.8")
        info = self.conn.volume.info()
        np.testing.assert_allclose(info.spacing_mm, 0.8)
        self.assertTrue(info.is_level_set)
        self.palpate("undo")
        self.require_equal(self.path, self.saved())


class Resampling(SparseTest):
    volume = "builtin:bumps:48"

    def test_it_is_one_edit_and_stays_where_it_is(self):
        before, values = self.conn.volume.info(), self.conn.volume.download().values
        isovalue = self.conn.settings.isovalue
        told = []
        spacing = tuple(before.spacing_mm * np.array((0.5, 1.0, 2.0)))
        result = self.conn.edit.filter("resample", spacing_mm=spacing,
                                       progress=lambda stage, share: told.append(share))
        after = self.conn.volume.info()
        self.assertEqual(after.shape, (95, 48, 24))
        np.testing.assert_allclose(after.spacing_mm, spacing)
        self.assertEqual(after.volume_revision, result.volume_revision)
        self.assertEqual(self.conn.settings.isovalue, isovalue)
        self.assertEqual(told, sorted(told))
        self.assertTrue(any(0 < share < 1 for share in told), told)
        # Every voxel that is one of the old ones has its value.
        filtered = self.conn.volume.download().values
        np.testing.assert_array_equal(filtered[::2, :, :], values[:, :, ::2])
        place = after.device_from_index @ np.array((94, 47, 23, 1))
        np.testing.assert_allclose(place, before.device_from_index @ np.array((47, 47, 46, 1)))
        self.assertEqual(result.undo_steps, 1)
        self.conn.edit.undo()
        np.testing.assert_array_equal(self.conn.volume.download().values, values)
        self.assertEqual(self.conn.volume.info().shape, before.shape)

    def test_it_is_recorded_and_replayed_bit_for_bit(self):
        recording = self.folder / "resampled.palrec"
        self.palpate("record", "start", recording)
        for number in range(3):
            self.conn.edit.filter("resample", spacing_mm=(0.7, 1.1, 0.9)[number])
            self.conn.edit.sphere((0, 0, 0), 5.0, "set", 0.1)
            self.conn.edit.undo()
        self.conn.edit.undo()
        self.palpate("record", "stop")
        lab = pathlib.Path(PALPATED).with_name("palpate-lab")
        ran = subprocess.run([lab, "replay", "--recording", recording], capture_output=True,
                             text=True, timeout=PATIENCE_S, check=False)
        self.assertEqual(ran.returncode, 0, ran.stdout + ran.stderr)

    def test_what_does_not_fit_together_is_refused(self):
        for arguments in (("--kind", "resample"), ("--kind", "offset"),
                          ("--kind", "mean", "--spacing-mm", "1"),
                          ("--kind", "gaussian", "--distance-mm", "1"),
                          ("--kind", "resample", "--spacing-mm", "1,2")):
            ran = command(self.daemon, "edit", "filter", *arguments)
            self.assertEqual(ran.returncode, USAGE, ran.stderr)
            self.assertIn("mm", ran.stderr)
        for arguments in ({"kind": "offset"}, {"kind": "mean", "spacing_mm": 1.0},
                          {"kind": "resample"}, {"kind": "resample", "spacing_mm": 1000.0},
                          {"kind": "offset", "distance_mm": 1.0}):
            with self.assertRaises(palpate.InvalidArgument):
                self.conn.edit.filter(**arguments)
