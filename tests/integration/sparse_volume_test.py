"""Sparse .vdb files and filters of whole volumes through the daemon: what is felt, chosen and
undone. How files are read and saved is tested in vdb_volume_test.cpp, how filters compute in
reshape_test.cpp."""

import json
import os
import pathlib
import subprocess
import tempfile

import numpy as np

import palpate
from support import DaemonTest, nrrd, pattern

# Of the sphere that vdb_tool makes, 64 voxels' edge: centre, world, and radius.
CENTER_MM = 0.5 * np.array((3.3, -5.7, 23.9))
RADIUS_MM = 14.4
USAGE, INVALID = 2, 3


class SparseTest(DaemonTest):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(
            tempfile.TemporaryDirectory(dir=self.daemon.folder)))

    def made(self, kind):
        path = self.folder / f"{kind}.vdb"
        subprocess.run([os.environ["PALPATE_VDB_TOOL"], "make", kind, "64", path], check=True)
        return path

    def settings(self):
        return json.loads(self.daemon.palpate("settings", "--json").stdout)


class LevelSets(SparseTest):
    volume = "builtin:sphere:16"

    def test_a_level_set_starts_at_its_surface_and_is_free_outside(self):
        sphere, cloud = self.made("sphere"), self.made("cloud")
        for other in (cloud, "builtin:sphere:48"):
            self.daemon.palpate("load", sphere)
            settings = self.settings()
            self.assertEqual((settings["isovalue"], settings["free_side"]), (0.0, "above"))
            self.daemon.palpate("load", other)
            settings = self.settings()
            self.assertEqual(settings["free_side"], "below")
            self.assertGreater(settings["isovalue"], 0.0)
        # What is asked for wins.
        self.daemon.palpate("load", sphere, "--isovalue", "0.5")
        self.assertEqual(self.settings()["isovalue"], 0.5)

    def test_grids_and_components_are_named(self):
        path, before = self.made("vector"), self.conn.volume.info().volume_revision
        ran = self.daemon.palpate("load", path, "--discard", code=INVALID)
        self.assertIn("--component", ran.stderr)
        self.assertEqual(self.conn.volume.info().volume_revision, before)
        self.daemon.palpate("load", path, "--discard", "--component", "magnitude", "--grid",
                            "velocity")
        self.assertAlmostEqual(self.conn.volume.info().value_max, 1.0, places=5)

    def require_felt(self, radius_mm):
        """A hand from outside touches the sphere, at this radius and nowhere else."""
        info = self.conn.volume.info()
        world_from_device = info.world_from_index @ np.linalg.inv(info.device_from_index)

        def distance_mm(points_mm):
            points = np.hstack([points_mm, np.ones((len(points_mm), 1))])
            return np.linalg.norm((points @ world_from_device.T)[:, :3] - CENTER_MM, axis=1)

        since = self.conn.settings.update(isovalue=0.0).settings_revision
        felt = 0
        with self.conn.poses(rate_hz=500, batch=100, waiting=100) as stream:
            for poses in stream:
                of_it = ((poses.volume_revision == info.volume_revision)
                         & (poses.settings_revision >= since) & poses.contact
                         & (poses.mode == palpate.ProxyMode.CONSTRAINED))
                # V is the sphere but for what is lost between voxels; H is within its cell.
                on_v = of_it & np.isfinite(poses.scp_v_mm).all(axis=1)
                for points, tolerance_mm in ((poses.scp_v_mm[on_v], 0.05),
                                             (poses.scp_h_mm[of_it], 0.25)):
                    np.testing.assert_allclose(distance_mm(points), radius_mm, atol=tolerance_mm)
                felt += on_v.sum()
                if felt > 200:
                    return

    def test_a_sphere_is_felt_where_filters_move_it(self):
        self.daemon.palpate("load", self.made("sphere"), "--discard",
                            "--device-mm-per-volume-mm", "0.9")
        values = self.conn.volume.download().values
        self.require_felt(RADIUS_MM)
        self.daemon.palpate("edit", "filter", "--kind", "offset", "--distance-mm", "4")
        self.require_felt(RADIUS_MM + 4)
        self.daemon.palpate("undo")
        np.testing.assert_array_equal(self.conn.volume.download().values, values)
        self.daemon.palpate("redo")
        self.require_felt(RADIUS_MM + 4)
        self.assertGreater(
            self.conn.edit.filter("mean-curvature", iterations=1).changed_voxels, 1000)
        self.daemon.palpate("edit", "filter", "--kind", "resample", "--spacing-mm", "0.8")
        info = self.conn.volume.info()
        np.testing.assert_allclose(info.spacing_mm, 0.8)
        self.assertTrue(info.is_level_set)


class Downloads(SparseTest):
    volume = "builtin:sphere:16"

    def state(self):
        """What palpated says of its volume, and all voxels. Suggestions are of a volume as loaded, so
        they may be others when its edits are loaded with it. What the first file left open is stated
        in the second."""
        path = self.folder / "state.nrrd"
        self.daemon.palpate("save", path, "--overwrite")
        volume = json.loads(self.daemon.palpate("info", "--json").stdout)["volume"]
        for name in ("source", "name", "volume_revision", "loaded_revision", "memory_bytes",
                     "unsaved_edits", "suggested_isovalues", "warnings"):
            del volume[name]
        return volume, path.read_bytes()

    def check_that_it_comes_back(self, path, value):
        self.daemon.palpate("load", path, "--discard")
        self.daemon.palpate("edit", "sphere", "--operation", "set", "--value", value,
                            "--center-voxels", "8,9,10", "--radius-voxels", "5")
        before = self.state()
        self.daemon.palpate("download", self.folder / "copy.vdb")
        self.daemon.palpate("load", self.folder / "copy.vdb", "--discard")
        self.assertEqual(self.state(), before)
        return before[0]

    def test_a_level_set_comes_back(self):
        volume = self.check_that_it_comes_back(self.made("sphere"), 0.25)
        self.assertTrue(volume["is_level_set"])

    def test_a_scan_comes_back(self):
        path = self.folder / "scan.nrrd"
        # Mirrored and turned.
        image = nrrd(pattern((37, 24, 30)) % 60013 - 30000,
                     ((0, -0.5, 0), (0.75, 0, 0), (0, 0, 2)), (5, 6, 7))
        header, _, voxels = image.partition(b"\n\n")
        path.write_bytes(header.replace(b"float", b"int16") + b'\nsample units: "HU"\n\n'
                         + np.frombuffer(voxels, "<f4").astype("<i2").tobytes())
        volume = self.check_that_it_comes_back(path, 7)
        self.assertEqual((volume["original_type"], volume["unit"]), ("int16", "HU"))


class Resampling(SparseTest):
    volume = "builtin:bumps:48"

    def test_each_axis_has_its_own_spacing(self):
        before = self.conn.volume.info()
        spacing = tuple(before.spacing_mm * np.array((0.5, 1.0, 2.0)))
        result = self.conn.edit.filter("resample", spacing_mm=spacing)
        after = self.conn.volume.info()
        self.assertEqual(after.shape, (95, 48, 24))
        np.testing.assert_allclose(after.spacing_mm, spacing)
        self.assertEqual(after.volume_revision, result.volume_revision)
        place = after.device_from_index @ np.array((94, 47, 23, 1))
        np.testing.assert_allclose(place, before.device_from_index @ np.array((47, 47, 46, 1)))
        self.conn.edit.undo()
        self.assertEqual(self.conn.volume.info().shape, before.shape)

    def test_what_does_not_fit_together_is_refused(self):
        for arguments in (("--kind", "resample"), ("--kind", "offset"),
                          ("--kind", "mean", "--spacing-mm", "1"),
                          ("--kind", "gaussian", "--distance-mm", "1"),
                          ("--kind", "resample", "--spacing-mm", "1,2")):
            ran = self.daemon.palpate("edit", "filter", *arguments, code=USAGE)
            self.assertIn("-mm", ran.stderr)
        for arguments in ({"kind": "offset"}, {"kind": "mean", "spacing_mm": 1.0},
                          {"kind": "resample"}, {"kind": "resample", "spacing_mm": 1000.0},
                          {"kind": "offset", "distance_mm": 1.0}):
            with self.assertRaises(palpate.InvalidArgument):
                self.conn.edit.filter(**arguments)
