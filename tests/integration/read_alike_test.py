"""Random good files of DICOM, TIFF and NIfTI, written and read by other programs: every voxel as
those read it. What palpated refuses and they read is listed."""

import collections
import os
import pathlib
import re
import subprocess
import tempfile
import unittest

import numpy as np

import palpate
from support import DaemonTest

try:
    import nibabel
    import pydicom
    import tifffile
    from pydicom.uid import (ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian,
                             RLELossless)
    nibabel.imageglobals.logger.setLevel("CRITICAL")
except ImportError:
    pydicom = None

TIMES = int(os.environ.get("PALPATE_READ_ALIKE", "1"))
# What tells passes apart, of the first and of the second.
PASSES = (("AcquisitionNumber", 3, 4), ("TemporalPositionIdentifier", 1, 2), ("EchoTime", 4.6, 9.2),
          ("AcquisitionTime", "101500", "101730"), ("TriggerTime", 0, 400),
          ("ConvolutionKernel", "B30f", "B70s"), ("KVP", 80, 140), ("FlipAngle", 5, 30))
CODECS = ("--jpegls", "--j2k", "--jpeg", "--rle")  # as gdcmconv names them
# All that may be refused, by a part of the line.
REFUSABLE = ("the format is not known by its name",)  # a NIfTI pair


def smooth(random, shape, least, greatest):
    """Integers that use the range, with some noise."""
    axes = np.meshgrid(*(np.linspace(0, 1 + 2 * random.random(), n) for n in shape), indexing="ij")
    wave = np.sin(sum(axes) * 4) * 0.5 + 0.5 + random.normal(0, 0.01, shape)
    return np.rint(least + np.clip(wave, 0, 1) * (float(greatest) - least)).astype(np.int64)


class Series:
    """A random series of DICOM in `folder`."""

    def __init__(self, random, folder):
        self.random, self.folder = random, folder
        self.codec = str(random.choice(["", "", *CODECS]))
        # GDCM writes no smaller ones.
        self.shape = tuple(int(n) for n in random.integers(3, 20, 3) +
                           (30 if self.codec == "--j2k" else 5 if self.codec else 0))
        allocated = int(random.choice([8, 16, 16, 16] if self.codec else [8, 16, 16, 32]))
        self.stored = int(random.integers(7, 9) if allocated == 8 else random.integers(10, 17))
        # GDCM compresses no signed bytes.
        self.signed = bool(random.integers(2)) and not (self.codec and allocated == 8)
        self.allocated = allocated
        if self.codec and allocated == 8:  # GDCM stops at an assertion of its own
            self.stored = 8
        self.high = self.stored - 1
        if not self.codec and random.integers(4) == 0:  # the bits may lie anywhere
            self.high = int(random.integers(self.stored - 1, allocated))
        self.slope, self.intercept = (1, -1024) if random.integers(2) else (
            round(float(random.uniform(0.1, 3)), 3), round(float(random.uniform(-2000, 2000)), 2))
        least = -(1 << (self.stored - 1)) if self.signed else 0
        self.values = smooth(random, self.shape, least, least + (1 << self.stored) - 1)
        self.padding = None
        if random.integers(3) == 0:  # below all others it stays
            self.padding = least if random.integers(2) else least + (1 << self.stored) - 1
            self.values[:2, :2] = self.padding
        passes = 1 + int(random.integers(3) == 0)
        self.uid, self.tag = pydicom.uid.generate_uid(), PASSES[random.integers(len(PASSES))]
        self.pitch = round(float(random.uniform(0.5, 5)), 2)
        self.half = float(random.choice([0, 0.5])) * self.pitch  # the second pass between the first
        turn = random.permutation(3)
        signs = np.diag(random.choice([-1.0, 1.0], 3))
        self.axes = (np.eye(3) @ signs)[:, turn]
        normal = np.cross(self.axes[:, 0], self.axes[:, 1])
        self.syntax = [ExplicitVRLittleEndian, ImplicitVRLittleEndian, ExplicitVRBigEndian][
            0 if self.codec else int(random.integers(3))]
        self.files = []
        for number in range(passes):
            for z in range(self.shape[2]):
                self.write(number, z, normal * (self.pitch * z + number * self.half), passes > 1)
        if self.codec:
            self.compress()

    def write(self, number, z, place, has_passes):
        path = self.folder / f"{self.random.integers(1 << 60):x}.dcm"
        meta = pydicom.dataset.FileMetaDataset()
        data = pydicom.dataset.FileDataset(str(path), {}, file_meta=meta, preamble=b"\0" * 128)
        meta.TransferSyntaxUID = self.syntax
        meta.MediaStorageSOPClassUID = data.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
        meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = pydicom.uid.generate_uid()
        data.StudyInstanceUID = data.SeriesInstanceUID = self.uid
        data.Modality, data.InstanceNumber = "CT", z + 1 + number * self.shape[2]
        data.ImagePositionPatient = [f"{x:.6f}" for x in place]
        data.ImageOrientationPatient = [float(x) for x in self.axes[:, :2].T.ravel()]
        data.PixelSpacing, data.SliceThickness = [0.7, 0.5], self.pitch
        data.RescaleSlope, data.RescaleIntercept = self.slope, self.intercept
        data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
        data.Columns, data.Rows = self.shape[:2]
        data.BitsAllocated, data.BitsStored = self.allocated, self.stored
        data.HighBit, data.PixelRepresentation = self.high, int(self.signed)
        if self.padding is not None:
            data.add_new("PixelPaddingValue", "SS" if self.signed else "US", self.padding)
        if has_passes:
            setattr(data, self.tag[0], self.tag[1 + number])
        values = self.values[:, :, z] if number == 0 else self.values[:, :, -1 - z]
        stored = (values << (self.high + 1 - self.stored)).astype(f"<u{self.allocated // 8}")
        data.PixelData = (stored.byteswap() if self.syntax == ExplicitVRBigEndian else
                          stored).tobytes(order="F") + b"\0" * (stored.nbytes % 2)
        data["PixelData"].VR = "OB" if self.allocated == 8 else "OW"
        data.is_little_endian = self.syntax != ExplicitVRBigEndian
        data.is_implicit_VR = self.syntax == ImplicitVRLittleEndian
        data.save_as(path, write_like_original=False)
        self.files.append((number, z, path))

    def compress(self):
        for *_, path in self.files:
            if self.codec == "--rle":
                data = pydicom.dcmread(path)
                data.compress(RLELossless, encoding_plugin="pydicom")
                data.save_as(path)
            else:
                subprocess.run(["gdcmconv", self.codec, path, f"{path}.c"], check=True)
                os.replace(f"{path}.c", path)

    def expected(self):
        """As pydicom reads the first pass."""
        slices = {z: pydicom.dcmread(path) for number, z, path in self.files if number == 0}
        stored = np.stack([slices[z].pixel_array.T for z in range(self.shape[2])], axis=2)
        return stored

    def __str__(self):
        return (f"{self.shape} of {self.stored} in {self.allocated} bits, high {self.high}, "
                f"{'signed' if self.signed else 'unsigned'}, {self.codec or self.syntax.name}, padding "
                f"{self.padding}, passes by {self.tag[0]} at {self.half}")


@unittest.skipUnless(pydicom, "pydicom, tifffile or nibabel is missing")
class ReadAlike(DaemonTest):
    volume = "builtin:sphere:16"

    def setUp(self):
        self.refused = collections.Counter()
        self.random = np.random.default_rng(int(os.environ.get("PALPATE_SEED", "91")))

    def each(self, count, read):
        for n in range(count * TIMES):
            with self.subTest(n=n), tempfile.TemporaryDirectory(dir=self.daemon.folder) as folder:
                read(pathlib.Path(folder))
        print(f"{self.id()}: {count * TIMES - self.refused.total()} of {count * TIMES} read; refused: "
              f"{dict(self.refused) or 'none'}")

    def check(self, source, expected, about, **options):
        """expected: (nx, ny, nz), before it is held as float32."""
        try:
            self.conn.volume.load(source, discard_edits=True, **options)
        except palpate.Error as error:
            reason = str(error).rpartition(": ")[2]
            self.refused[reason] += 1
            self.assertTrue(any(part in reason for part in REFUSABLE), f"{about}: {error}")
            return
        read = self.conn.volume.download().values
        self.assertEqual(read.shape, expected.shape, about)
        different = read.astype(np.float32) != expected.astype(np.float32)
        self.assertFalse(different.any(), f"{about}: {different.sum()} voxels differ, as "
                         f"{read[different][:1]} and {expected[different][:1]}")

    def test_dicom(self):
        def read(folder):
            series = Series(self.random, folder)
            stored = series.values
            if series.high + 1 == series.stored:  # pydicom leaves the others to the caller
                np.testing.assert_array_equal(series.expected(), stored, str(series))
            expected = series.intercept + series.slope * stored.astype(np.float64)
            if series.padding == stored.max():
                outside = stored == series.padding
                expected[outside] = expected[~outside].min()
            self.check(folder, expected, str(series))
        self.each(300, read)

    def test_tiff(self):
        def read(folder):
            random = self.random
            kind = str(random.choice(["plain", "files", "imagej", "ome", "ome"]))
            dtype = str(random.choice(["u1", "u2", "f4"] if kind == "imagej" else
                                      ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"]))
            shape = tuple(int(n) for n in random.integers(3, 20, 3))  # z, y, x
            about = f"{kind} {dtype} {shape}"
            limits = np.iinfo(dtype) if dtype[0] in "iu" else np.finfo("f4")
            bound = (limits.min, limits.max) if limits.max < 1 << 24 else (0, 1 << 23)
            values = smooth(random, shape, *bound).astype(dtype)
            more = {"photometric": "minisblack", "byteorder": str(random.choice(["<", ">"])),
                    "bigtiff": bool(random.integers(2))}
            if kind != "imagej":
                more["compression"] = random.choice([None, "zlib"])
                if random.integers(2):
                    more["tile"] = (16, 32)
                else:
                    more["rowsperstrip"] = int(random.integers(1, shape[1] + 1))
            path, metadata, line = folder / "v.tif", None, (0.0, 1.0)
            if kind == "imagej":
                more |= {"imagej": True, "bigtiff": False, "byteorder": None,
                         "resolution": (1 / 0.3, 1 / 0.2)}
                metadata = {"spacing": 0.5, "unit": "mm", "axes": "ZYX"}
                if random.integers(2):
                    line = (-32768.0, 1.0) if dtype == "u2" else (7.0, 0.5)
                    metadata |= {"cf": 0, "c0": line[0], "c1": line[1], "vunit": "HU"}
            elif kind == "ome":
                more["ome"] = True
                metadata = {"axes": "ZYX"}
                for axis, size in zip("XYZ", (0.3, 0.2, 0.5)):
                    metadata |= {f"PhysicalSize{axis}": size, f"PhysicalSize{axis}Unit": "mm"}
            if kind == "files":
                for z, page in enumerate(values):
                    tifffile.imwrite(folder / f"s{z + 1}.tif", page, **more)
            else:
                tifffile.imwrite(path, values, metadata=metadata, **more)
            if kind == "ome" and random.integers(2):
                self.permute(path, shape[0])
            alike = values if kind == "files" else tifffile.imread(path)
            expected = line[0] + line[1] * alike.astype(np.float64)
            options = {} if kind in ("imagej", "ome") else {"spacing_mm": (0.3, 0.2, 0.5)}
            self.check(folder if kind == "files" else path, expected.T, about, **options)
            if kind in ("imagej", "ome"):
                np.testing.assert_allclose(self.conn.volume.info().spacing_mm, (0.3, 0.2, 0.5))
        self.each(100, read)

    def permute(self, path, slices):
        """Gives the pages another order."""
        planes = "".join(f"<TiffData FirstZ='{z}' IFD='{page}' PlaneCount='1'/>"
                         for page, z in enumerate(self.random.permutation(slices)))
        text = re.sub("<TiffData.*?/>", planes, tifffile.tiffcomment(path))
        tifffile.tiffcomment(path, text.encode())

    def test_nifti(self):
        def read(folder):
            random = self.random
            dtype = random.choice(["<", ">"]) + str(random.choice(
                ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"]))
            shape = tuple(int(n) for n in random.integers(3, 20, 3 + int(random.integers(4) == 0)))
            about = f"{dtype} {shape}"
            values = smooth(random, shape, *((0, 100) if dtype[1] == "u" else (-100, 100)))
            turned = np.diag([*(random.choice([-1.0, 1.0], 3) * random.uniform(0.2, 3, 3)), 1])
            turned[:3] = turned[:3][random.permutation(3)]
            turned[:3, 3] = random.uniform(-200, 200, 3)
            header = nibabel.Nifti1Header(endianness=dtype[0])
            header.set_data_dtype(dtype)
            kind = [nibabel.Nifti1Image, nibabel.Nifti1Pair, nibabel.Nifti2Image][random.integers(3)]
            if kind == nibabel.Nifti2Image:
                header = nibabel.Nifti2Header.from_header(header)
            header.set_xyzt_units("mm")
            image = kind(values.astype(dtype), None, header)
            image.set_qform(turned, int(random.integers(2)))
            image.set_sform(turned, 1)
            if random.integers(2):
                image.header.set_slope_inter(round(random.uniform(0.1, 2), 3), random.integers(-9, 9))
            path = folder / ("v.img" if kind == nibabel.Nifti1Pair else
                             str(random.choice(["v.nii", "v.nii.gz"])))
            nibabel.save(image, path)
            alike = np.asarray(nibabel.load(path).dataobj, np.float64)
            self.check(folder / "v.hdr" if path.suffix == ".img" else path,
                       alike if alike.ndim == 3 else alike[..., 0], about)
        self.each(100, read)


if __name__ == "__main__":
    unittest.main()
