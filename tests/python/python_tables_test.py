"""Ticks as palpate-lab exports them; as tables of pandas; ticks and volumes as xarray has them."""

import csv
import dataclasses
import io
import os
import subprocess
import unittest
import unittest.mock

import numpy as np

import palpate
from python_recording_test import RecordingTest

try:
    import pandas
except ImportError:
    pandas = None
try:
    import xarray
except ImportError:
    xarray = None


def exported(path):
    """The rows of the command line's table."""
    said = subprocess.run([os.environ["PALPATE_LAB"], "export", path], check=True, text=True,
                          capture_output=True).stdout
    return list(csv.DictReader(io.StringIO(said)))


class Ticks(RecordingTest):
    def test_every_tick_is_that_of_the_table(self):
        rows, ticks = exported(self.path), self.recording.ticks
        self.assertEqual(len(rows), len(ticks))
        compared = {"markers"}

        def column(name, kind=float):
            compared.add(name)
            return np.array([kind(row[name]) for row in rows])

        for name in ("tick", "time_ns", "buttons", "scene_revision", "settings_revision",
                     "volume_revision", "update_ns", "iterations", "missed_ticks", "capped_ticks",
                     "faulty_ticks"):
            np.testing.assert_array_equal(getattr(ticks, name), column(name, int), name)
        for name in ("density", "isovalue", "force_limit_n"):
            np.testing.assert_array_equal(getattr(ticks, name), column(name), name)
        for name in ("contact", "input_rejected", "docked", "calibrated"):
            np.testing.assert_array_equal(getattr(ticks, name), column(name, int) == 1, name)
        for name, kind in (("mode", palpate.ProxyMode), ("free_side", palpate.FreeSide),
                           ("force_state", palpate.ForceState),
                           ("force_reason", palpate.ForceReason),
                           ("force_command", palpate.ForceCommand),
                           ("device_status", palpate.DeviceStatus)):
            self.assertEqual([str(kind(n)) for n in getattr(ticks, name)],
                             column(name, str).tolist(), name)
        has_v = column("has_scp_v", int) == 1
        for name, stem, unit, there in (
                ("hip_mm", "hip", "_mm", True), ("scp_h_mm", "scp_h", "_mm", True),
                ("force_n", "force", "_n", True), ("scp_v_mm", "scp_v", "_mm", has_v),
                ("scp_h_normal", "scp_h_normal", "", ticks.contact),
                ("scp_v_normal", "scp_v_normal", "", has_v)):
            expected = np.stack([column(f"{stem}_{axis}{unit}") for axis in "xyz"], axis=1)
            expected[~(there | np.zeros(len(ticks), bool))] = np.nan
            np.testing.assert_array_equal(getattr(ticks, name), expected, name)
        np.testing.assert_array_equal(
            ticks.stylus_orientation,
            np.stack([column(f"stylus_{part}") for part in "wxyz"], axis=1))
        self.assertEqual(compared, set(rows[0]))
        self.assertTrue(ticks.contact.any() and has_v.any())


    def test_a_table_replaces_a_file_only_when_told_to(self):
        table = self.folder / "table.csv"
        table.write_text("precious")
        command = [os.environ["PALPATE_LAB"], "export", self.path, "--out", table]
        self.assertEqual(subprocess.run(command, capture_output=True, check=False).returncode, 7)
        self.assertEqual(table.read_text(), "precious")
        subprocess.run([*command, "--overwrite"], check=True, capture_output=True)
        self.assertTrue(table.read_text().startswith("tick,"))


class Tables(RecordingTest):
    @unittest.skipUnless(pandas, "pandas is not installed")
    def test_pandas_has_the_columns_of_the_command_line(self):
        frame = self.recording.ticks.to_pandas()
        rows = exported(self.path)
        self.assertEqual({*frame.columns, "tick"}, set(rows[0]) - {"has_scp_v", "markers"})
        self.assertEqual(frame.index.tolist(), [int(row["tick"]) for row in rows])
        for name in ("mode", "force_state", "device_status"):
            self.assertEqual(frame[name].tolist(), [row[name] for row in rows])
        for name in ("hip_x_mm", "force_z_n", "stylus_w"):
            self.assertEqual(frame[name].tolist(), [float(row[name]) for row in rows])

    @unittest.skipUnless(pandas, "pandas is not installed")
    def test_pandas_of_poses(self):
        poses = self.expected["poses"]
        frame = poses.to_pandas()
        self.assertEqual(len(frame), len(poses))
        np.testing.assert_array_equal(frame["force_y_n"], poses.force_n[:, 1])
        self.assertEqual(set(frame["mode"]), {str(palpate.ProxyMode(n)) for n in poses.mode})
        self.assertTrue(frame.groupby("mode", observed=True)["update_ns"].mean().gt(0).all())

    @unittest.skipUnless(xarray, "xarray is not installed")
    def test_xarray_of_ticks(self):
        for ticks in (self.expected["poses"], self.recording.ticks):
            data = ticks.to_xarray()
            tick = int(ticks.tick[len(ticks) // 2])
            np.testing.assert_array_equal(data.hip_mm.sel(tick=tick, axis="z"),
                                          ticks.hip_mm[len(ticks) // 2, 2])
            self.assertEqual(data.hip_mm.attrs["units"], "mm")
            self.assertEqual(data.force_n.attrs["units"], "N")
            self.assertNotIn("units", data.density.attrs)
            self.assertIn("1: free", data["mode"].attrs["words"])
            self.assertEqual(data.stylus_orientation.dims, ("tick", "part"))

    @unittest.skipUnless(xarray, "xarray is not installed")
    def test_xarray_of_a_volume(self):
        volume = self.expected["volume"]
        data = volume.to_xarray()
        self.assertEqual((data.dims, data.shape), (("x", "y", "z"), (20, 33, 18)))
        self.assertEqual(float(data.sel(x=1.5, y=2, z=10)), volume.values[3, 2, 5])
        self.assertEqual(data.attrs["units"], "HU")

    @unittest.skipUnless(xarray, "xarray is not installed")
    def test_xarray_of_a_volume_in_the_world(self):
        volume = self.expected["volume"]

        def along(matrix):
            data = dataclasses.replace(volume, world_from_index=np.array(matrix)).to_xarray()
            return data.attrs["coordinates_frame"], [
                (float(data[axis][0]), float(data[axis][1])) for axis in "xyz"]

        # As of a scanner: x and y mirrored. The last two lean a little, and too much.
        mirrored = [[-0.5, 0, 0, 90.25], [0, -1, 0, -7], [0, 0, 2, 300], [0, 0, 0, 1]]
        there = ("world", [(90.25, 89.75), (-7, -8), (300, 302)])
        self.assertEqual(along(mirrored), there)
        mirrored[0][1] = 1e-7
        self.assertEqual(along(mirrored), there)
        mirrored[0][1] = 1e-3
        self.assertEqual(along(mirrored), ("volume", [(0, 0.5), (0, 1), (0, 2)]))

    def test_a_package_that_is_not_there_is_named(self):
        poses = self.expected["poses"]
        for name, call in (("pandas", poses.to_pandas), ("xarray", poses.to_xarray),
                           ("xarray", self.expected["volume"].to_xarray)):
            with unittest.mock.patch.dict("sys.modules", {name: None}), \
                    self.assertRaisesRegex(palpate.FailedPrecondition,
                                           f"apt-get install python3-{name}"):
                call()


if __name__ == "__main__":
    unittest.main()
