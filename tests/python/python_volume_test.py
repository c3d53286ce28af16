"""Volumes as arrays: down, up, and from files; which axis is which."""

import json
import os
import subprocess
import unittest

import numpy as np

import palpate
from dicom_series import dicom_slice
from support import PALPATE, Daemon, DaemonTest, nrrd, pattern

# At right angles, with a spacing of its own along each.
TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
SPACING_MM = np.array([0.5, 0.75, 1.25])
ORIGIN_MM = np.array([-10.5, 20.25, 1000.0 / 3])


def world_from_index():
    matrix = np.eye(4)
    matrix[:3, :3] = TURN * SPACING_MM
    matrix[:3, 3] = ORIGIN_MM
    return matrix


class Folders(DaemonTest):
    def test_a_folder_of_slices_is_sent(self):
        folder = self.daemon.folder / "CT"
        folder.mkdir()
        for z in range(4):
            voxels = np.full(16 * 12, 900 if z in (1, 2) else -1000, "<i2").tobytes()
            (folder / f"{z}.dcm").write_bytes(dicom_slice(z, 16, 12, voxels))
        told = self.daemon.palpate("upload", f"{folder}/").stdout
        self.assertIn("isovalue 300 HU", told)
        info = self.conn.volume.upload_file(folder)
        self.assertEqual((info.source, info.shape, info.unit), ("upload:CT", (16, 12, 4), "HU"))
        suggested = self.conn.volume.suggested_isovalues()
        self.assertEqual(suggested[0].name, "bone")
        self.assertEqual(self.conn.settings.isovalue, suggested[0].isovalue)

    def test_a_unit_that_is_no_length_is_a_warning(self):
        path = self.daemon.folder / "pixels.nrrd"
        for unit, code in ((b"pixel", 0), (b"parsec", 3)):
            path.write_bytes(nrrd(pattern((8, 8, 8))).replace(
                b"endian:", b'space units: "%b" "%b" "%b"\nendian:' % ((unit,) * 3)))
            self.daemon.palpate("load", path, code=code)
            if code == 0:
                self.assertIn("pixel", " ".join(self.conn.volume.info().warnings))
            # Then the file's own does not matter.
            self.daemon.palpate("load", path, "--spacing-mm", "1,2,3")
            np.testing.assert_allclose(self.conn.volume.info().spacing_mm, (1, 2, 3))
            self.assertEqual(self.conn.volume.info().warnings, ())


class Download(DaemonTest):
    def test_a_file_comes_back_voxel_by_voxel(self):
        values = pattern((21, 9, 34))
        path = self.daemon.folder / "pattern.nrrd"
        path.write_bytes(nrrd(values, (TURN * SPACING_MM).T.tolist(), ORIGIN_MM.tolist()))
        info = self.conn.volume.load(path)
        self.assertEqual(info.shape, (21, 9, 34))
        volume = self.conn.volume.download()
        self.assertEqual(volume.values.dtype, np.float32)
        np.testing.assert_array_equal(volume.values, values)
        self.assertEqual(volume.values[20, 3, 7], 10000 * 20 + 100 * 3 + 7)
        np.testing.assert_allclose(volume.spacing_mm, SPACING_MM, rtol=1e-6)
        np.testing.assert_allclose(volume.world_from_index, world_from_index(), rtol=1e-6)
        np.testing.assert_array_equal(volume.device_from_index, info.device_from_index)
        self.assertEqual((volume.value_min, volume.value_max), (values.min(), values.max()))
        self.assertEqual((volume.source, volume.volume_revision),
                         (str(path), info.volume_revision))

    def test_each_type_comes_back_as_it_is(self):
        random = np.random.default_rng(3)
        for kind, low, high in (("u1", 0, 256), ("<i2", -1024, 3072), ("<u2", 0, 65536)):
            values = random.integers(low, high, (70, 45, 33)).astype(kind)
            values[:40, :20] = low + 5
            self.conn.volume.upload(values)
            volume = self.conn.volume.download()
            self.assertEqual((volume.dtype, volume.values.dtype), (values.dtype, values.dtype))
            np.testing.assert_array_equal(volume.values, values)
            np.testing.assert_array_equal(volume[3:50, -20:, 7], values[3:50, -20:, 7])
            self.assertIn(str(values.dtype), repr(volume))
            self.assertIn(str(values.dtype), volume._repr_html_())
            # Its holder's own.
            volume.values[:] = 3
            np.testing.assert_array_equal(volume[:], values)

    def test_constant_and_single_bricks_and_more_than_one_chunk(self):
        noise = np.random.default_rng(7).standard_normal((100, 90, 80)).astype(np.float32)
        for values in (np.full((8, 8, 8), 3.0), np.full((40, 3, 9), -2.0), np.zeros((2, 2, 2)),
                       noise):
            values[0, 0, 0] += 1
            self.conn.volume.upload(values)
            np.testing.assert_array_equal(self.conn.volume.download().values, values)


class Upload(DaemonTest):
    def test_an_array_goes_there_and_comes_back(self):
        values = pattern((19, 26, 11), np.int32)
        info = self.conn.volume.upload(values, (0.5, 2.0, 3.0), unit="HU", name="mine",
                                       isovalue=90500.0)
        self.assertEqual((info.shape, info.unit, info.source, info.original_type),
                         ((19, 26, 11), "HU", "upload:mine.nrrd", "int32"))
        np.testing.assert_array_equal(info.spacing_mm, (0.5, 2.0, 3.0))
        np.testing.assert_array_equal(info.world_from_index, np.diag([0.5, 2.0, 3.0, 1.0]))
        volume = self.conn.volume.download()
        np.testing.assert_array_equal(volume.values, values)
        self.assertEqual(volume.unit, "HU")
        self.assertEqual(self.conn.settings.isovalue, 90500.0)
        poses = next(self.conn.poses(100))
        self.assertEqual(poses.volume_revision[0], info.volume_revision)

    def test_an_oblique_frame(self):
        values = pattern((9, 10, 11))
        info = self.conn.volume.upload(values, world_from_index=world_from_index())
        np.testing.assert_allclose(info.world_from_index, world_from_index(), rtol=1e-6)
        np.testing.assert_allclose(info.spacing_mm, SPACING_MM, rtol=1e-6)
        copy = self.conn.volume.download()
        self.assertEqual(info.patient_axes, "")  # nobody says that it is a patient's
        again = self.conn.volume.upload(copy.values, world_from_index=copy.world_from_index,
                                        patient_axes="LPS")
        self.assertEqual(again.patient_axes, "LPS")
        np.testing.assert_allclose(again.world_from_index, info.world_from_index, rtol=1e-12)

    def test_every_type_and_layout(self):
        values = pattern((5, 6, 7)) % 97
        for kind in ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", ">i2", ">f4"):
            self.conn.volume.upload(values.astype(kind))
            np.testing.assert_array_equal(self.conn.volume.download().values, values, kind)
        for held in (np.asfortranarray(values), np.repeat(values, 2, axis=1)[:, ::2],
                     values.T.copy().T, values[::-1][::-1]):
            self.conn.volume.upload(held)
            np.testing.assert_array_equal(self.conn.volume.download().values, values)
        mask = values > 50
        self.conn.volume.upload(mask)
        np.testing.assert_array_equal(self.conn.volume.download().values, mask)

    def test_what_is_refused_leaves_the_volume(self):
        before = self.conn.volume.info().volume_revision
        good, cut = pattern((8, 8, 8)), self.daemon.folder / "cut.nrrd"
        cut.write_bytes(nrrd(good)[:-9])
        refused = [lambda: self.conn.volume.upload(good.astype(np.int64)),
                   lambda: self.conn.volume.upload(good.astype(complex)),
                   lambda: self.conn.volume.upload(good[0]),
                   lambda: self.conn.volume.upload(np.zeros((0, 4, 4))),
                   lambda: self.conn.volume.upload(good, (1, 2)),
                   lambda: self.conn.volume.upload(good, (1, 2, 0)),
                   lambda: self.conn.volume.upload(good, world_from_index=np.eye(3)),
                   lambda: self.conn.volume.upload(good, patient_axes="LPS"),
                   lambda: self.conn.volume.upload(np.full((8, 8, 8), np.nan)),
                   lambda: self.conn.volume.upload(good, unit='a "b"'),
                   lambda: self.conn.volume.upload(good, isovalue=1.0, normalized_isovalue=0.5),
                   lambda: self.conn.volume.load(""),
                   lambda: self.conn.volume.load("builtin:sphere:16", isovalue=True),
                   lambda: self.conn.volume.load("builtin:sphere:16", frame=-1),
                   lambda: self.conn.volume.load("builtin:sphere:16", frame="0"),
                   lambda: self.conn.volume.load("builtin:sphere:16", grid=5),
                   lambda: self.conn.volume.load("builtin:sphere:16", raw=(8, 8, 8)),
                   lambda: self.conn.volume.load("builtin:sphere:16", discard_edits="no"),
                   lambda: self.conn.volume.load(5),
                   lambda: self.conn.volume.save(5),
                   lambda: self.conn.volume.save("x.nrrd", overwrite="yes"),
                   lambda: self.conn.volume.place(rotation_wxyz="turned"),
                   lambda: self.conn.volume.place(turn_deg=("y", float("inf"))),
                   lambda: self.conn.volume.place(scale_by=1, expected_revision=-1),
                   lambda: self.conn.volume.upload(good, world_from_index="here"),
                   lambda: self.conn.volume.upload(good, unit=5),
                   lambda: self.conn.volume.load("builtin:nothing"),
                   lambda: self.conn.volume.load(cut)]
        for call in refused:
            with self.assertRaises(palpate.InvalidArgument) as caught:
                call()
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaises(palpate.NotFound):
            self.conn.volume.load("/nowhere/at/all.nrrd")
        self.assertEqual(self.conn.volume.info().volume_revision, before)

    def test_what_is_saved_loads_again(self):
        self.conn.volume.load("builtin:bumps:64", normalized_isovalue=0.25)
        self.assertAlmostEqual(self.conn.settings.normalized_isovalue, 0.25)
        path = self.daemon.folder / "saved.nrrd"
        revision = self.conn.volume.save(path)
        self.assertEqual(revision, self.conn.volume.info().volume_revision)
        before = self.conn.volume.download().values
        self.conn.volume.load(path)
        np.testing.assert_array_equal(self.conn.volume.download().values, before)
        with self.assertRaises(palpate.Conflict):
            self.conn.volume.save(path)
        self.conn.volume.save(path, overwrite=True)

    def test_what_the_command_line_downloads_is_the_volume_with_its_edits(self):
        self.conn.volume.upload(pattern((20, 21, 22)), (0.5, 1, 2))
        self.conn.edit.sphere((9, 9, 9), 5, "set", 7.0, frame="index")
        volume = self.conn.volume.download()
        path = self.daemon.folder / "copy.nrrd"
        self.assertIn(str(volume.volume_revision), self.daemon.palpate("download", path).stdout)
        # A copy elsewhere is not one that the daemon knows to be saved.
        self.conn.volume.load(path, discard_edits=True)
        again = self.conn.volume.download()
        np.testing.assert_array_equal(again.values, volume.values)
        np.testing.assert_allclose(again.world_from_index, volume.world_from_index, atol=1e-12)


class Warnings(DaemonTest):
    """What an import assumed reaches whoever asked for it, and those who come later."""

    EXPECTED = ("3 voxels are not finite", "no spacing is stated")  # the second of raw voxels

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        values = pattern((8, 8, 8))
        values[2, 3, 1:4] = np.nan
        cls.path = cls.daemon.folder / "odd.nrrd"
        cls.path.write_bytes(nrrd(values))
        raw = cls.daemon.folder / "odd.raw"
        raw.write_bytes(values.astype("<f4").tobytes(order="F"))
        cls.raw = (raw, "--raw-size", "8,8,8", "--raw-type", "float32")

    def check(self, warnings, count=1):
        """The first `count` of EXPECTED, and no others."""
        self.assertEqual(len(warnings), count, warnings)
        for warning, begin in zip(sorted(warnings), self.EXPECTED):
            self.assertTrue(warning.startswith(begin), warnings)

    def test_python(self):
        self.check(self.conn.volume.load(self.path).warnings)
        with self.daemon.connect() as other:
            self.check(other.volume.info().warnings)
        self.conn.edit.sphere((4.0, 4.0, 4.0), 2.0, "set", 50.0, frame="index")
        self.check(self.conn.volume.info().warnings)
        values = pattern((8, 8, 8))
        self.assertEqual(self.conn.volume.upload(values, discard_edits=True).warnings, ())
        values[0, 0, 0] = np.inf
        (warning,) = self.conn.volume.upload(values).warnings
        self.assertTrue(warning.startswith("1 voxels are not finite"), warning)
        self.assertEqual(self.conn.volume.info().warnings, (warning,))

    def test_command_line(self):
        for count, command in ((2, ("load", *self.raw)), (2, ("upload", *self.raw)),
                               (1, ("series", "load", self.path, self.path))):
            with self.subTest(command[0]):
                ran = self.daemon.palpate(*command)
                lines = [line for line in ran.stderr.splitlines() if "warning" in line]
                self.check([line.removeprefix("palpate: warning: ") for line in lines], count)
                self.assertNotIn("warning", ran.stdout)
                volume = json.loads(self.daemon.palpate("info", "--json").stdout)["volume"]
                self.check(volume["warnings"], count)
                lines = self.daemon.palpate("info").stdout.splitlines()
                self.check([line.strip().removeprefix("warning: ") for line in lines
                            if any(words in line for words in self.EXPECTED)], count)

    def test_a_name_that_is_not_utf_8_is_called_that(self):
        name = os.fsencode(self.daemon.folder) + b"/sch\xe4del.nrrd"
        with open(name, "wb") as file:
            file.write(nrrd(pattern((8, 8, 8))))
        for command in (("load", name), ("upload", name), ("record", "start", name),
                        ("series", "load", name, name)):
            with self.subTest(command=command[0]):
                ran = subprocess.run([PALPATE, *command, "--socket", self.daemon.socket],
                                     capture_output=True, check=False)
                self.assertEqual(ran.returncode, 3, ran.stderr)
                self.assertIn(b"Latin-1", ran.stderr)
        with self.assertRaisesRegex(palpate.InvalidArgument, "Latin-1"):
            self.conn.volume.load(os.fsdecode(name))

    def test_first_volume(self):
        with Daemon(self.path) as daemon, daemon.connect() as conn:
            self.check(conn.volume.info().warnings)


if __name__ == "__main__":
    unittest.main()
