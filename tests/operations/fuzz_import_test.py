"""Damaged files of every format through palpate-import: each is a volume or a refusal of
one line, within its limits of memory and time, and nothing is left where it was refused.

The import tests damage headers of known files; here every byte may change. A fixed seed;
PALPATE_TORTURE times as many files in the long run."""

import gzip
import os
import pathlib
import random
import shutil
import struct
import subprocess
import tempfile
import time
import unittest

from support import SANITIZED

IMPORT = pathlib.Path(os.environ["PALPATED"]).with_name("palpate-import")
FILES = 14 * int(os.environ.get("PALPATE_TORTURE", "1"))  # of each format
SIZE = (7, 5, 4)
VOXELS = bytes(struct.pack("<h", 3 * x + 17 * y + 29 * z)[n] for z in range(SIZE[2])
               for y in range(SIZE[1]) for x in range(SIZE[0]) for n in range(2))
MEMORY_MIB = 512
# The importer's own code and libraries.
BASE_MIB = 300
TIMEOUT_S = 20
WRITTEN, FAILED, INVALID, TOO_LARGE = 0, 1, 3, 6


def nrrd(encoding):
    data = gzip.compress(VOXELS) if encoding == "gzip" else VOXELS
    return (b"NRRD0005\ntype: int16\ndimension: 3\nspace: left-posterior-superior\nsizes: 7 5 4\n"
            b"space directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (1,2,3)\nendian: little\n"
            b"kinds: domain domain domain\nencoding: " + encoding.encode() + b"\n\n" + data)


def meta_image():
    return (b"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
            b"CompressedData = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n"
            b"ElementSpacing = 1 1 2\nDimSize = 7 5 4\nElementType = MET_SHORT\n"
            b"ElementDataFile = LOCAL\n" + VOXELS)


def nifti():
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *SIZE, 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, 4, 16)
    struct.pack_into("<8f", header, 76, 1, 1, 1, 2, 0, 0, 0, 0)
    struct.pack_into("<3f", header, 108, 352, 1, 0)
    struct.pack_into("<B", header, 123, 2)
    header[344:348] = b"n+1\0"
    return bytes(header) + VOXELS


def tiff():
    """Pages of one strip of 16 bits."""
    page_bytes = 2 * SIZE[0] * SIZE[1]
    out = bytearray(struct.pack("<2sHI", b"II", 42, 8))
    for z in range(SIZE[2]):
        begin = len(out)
        tags = [(256, 4, SIZE[0]), (257, 4, SIZE[1]), (258, 3, 16), (259, 3, 1), (262, 3, 1),
                (273, 4, begin + 2 + 12 * 10 + 4), (277, 3, 1), (278, 4, SIZE[1]),
                (279, 4, page_bytes), (339, 3, 2)]
        out += struct.pack("<H", len(tags))
        for tag, kind, value in tags:
            out += struct.pack("<HHII", tag, kind, 1, value)
        last = z == SIZE[2] - 1
        out += struct.pack("<I", 0 if last else begin + 2 + 12 * 10 + 4 + page_bytes)
        out += VOXELS[z * page_bytes:(z + 1) * page_bytes]
    return bytes(out)


def dicom(z):
    def element(group, number, kind, value):
        if isinstance(value, str):
            value = value.encode()
        if len(value) % 2:
            value += b"\0" if kind in ("UI", "OB") else b" "
        length = struct.pack("<HI", 0, len(value)) if kind in ("OW", "OB") \
            else struct.pack("<H", len(value))
        return struct.pack("<HH", group, number) + kind.encode() + length + value

    def short(value):
        return struct.pack("<H", value)
    image = "1.2.840.10008.5.1.4.1.1.2"
    meta = (element(2, 1, "OB", b"\0\1") + element(2, 2, "UI", image)
            + element(2, 3, "UI", f"1.2.3.{z + 1}") + element(2, 16, "UI", "1.2.840.10008.1.2.1"))
    page = 2 * SIZE[0] * SIZE[1]
    return (bytes(128) + b"DICM" + element(2, 0, "UL", struct.pack("<I", len(meta))) + meta
            + element(8, 0x16, "UI", image) + element(8, 0x18, "UI", f"1.2.3.{z + 1}")
            + element(8, 0x60, "CS", "CT") + element(0x20, 0xd, "UI", "1.2.9")
            + element(0x20, 0xe, "UI", "1.2.3") + element(0x20, 0x13, "IS", str(z + 1))
            + element(0x20, 0x32, "DS", f"10\\20\\{30 + 2 * z}")
            + element(0x20, 0x37, "DS", "1\\0\\0\\0\\1\\0") + element(0x28, 2, "US", short(1))
            + element(0x28, 4, "CS", "MONOCHROME2") + element(0x28, 0x10, "US", short(SIZE[1]))
            + element(0x28, 0x11, "US", short(SIZE[0])) + element(0x28, 0x30, "DS", "0.75\\0.5")
            + element(0x28, 0x100, "US", short(16)) + element(0x28, 0x101, "US", short(16))
            + element(0x28, 0x102, "US", short(15)) + element(0x28, 0x103, "US", short(1))
            + element(0x7fe0, 0x10, "OW", VOXELS[z * page:(z + 1) * page]))


def damaged(data, rng):
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        place = rng.randrange(len(data)) if rng.random() < 0.5 else rng.randrange(
            min(len(data), 400))
        kind = rng.random()
        if kind < 0.5:
            data[place] ^= 1 << rng.randrange(8)
        elif kind < 0.7:
            data[place:place + 4] = rng.choice((b"\xff" * 4, bytes(4), b"\x7f" + b"\xff" * 3, b"9999"))
        elif kind < 0.8:
            data[place:place] = rng.randbytes(rng.choice((1, 7, 400)))
        elif kind < 0.9:
            del data[place:place + rng.choice((1, 5, 60))]
        else:
            del data[place:]
        data = data or bytearray(b"\0")
    return bytes(data)


class FuzzedFiles(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.output = self.folder / "out.vdb"

    def run_import(self, source, options=()):
        """(exit code, stderr, MiB, seconds)"""
        self.output.unlink(missing_ok=True)
        began = time.monotonic()
        with open(self.folder / "stderr", "w+b") as said:
            process = subprocess.Popen(
                [IMPORT, source, self.output, "--max-memory-mib", str(MEMORY_MIB), "--timeout-s",
                 str(TIMEOUT_S), *options], stdout=subprocess.DEVNULL, stderr=said)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            process.poll()  # says whether it crashed
            said.seek(0)
            text = said.read().decode(errors="replace")
        return (process.returncode, text, usage.ru_maxrss / 1024, time.monotonic() - began)

    def check(self, name, write, seed, options=()):
        """Of files that `write` writes: whole as they are, and damaged."""
        source = write(seed)
        code, text, _, _ = self.run_import(source, options)
        self.assertEqual(code, WRITTEN, f"{name} is no seed: {text}")
        rng, codes = random.Random(f"{name} 8"), {}
        for number in range(FILES):
            source = write(damaged(seed, rng))
            code, text, mib, seconds = self.run_import(source, options)
            said = f"{name} {number}: {code} {text}"
            lines = [line for line in text.splitlines() if not line.startswith("warning")]
            # Readers that are not ours may crash: the importer says so itself.
            self.assertIn(code, (WRITTEN, INVALID, TOO_LARGE, FAILED), said)
            if SANITIZED and "requested allocation size" in text:
                continue  # new throws elsewhere: AddressSanitizer ends the program
            self.assertNotIn("Sanitizer", text, said)
            if code == FAILED:
                self.assertIn("the reader crashed", text, said)
            if code != WRITTEN:
                self.assertEqual(len(lines), 1, said)
                self.assertFalse(self.output.exists(), said)
            if not SANITIZED:
                self.assertLess(mib, MEMORY_MIB + BASE_MIB, said)
            self.assertLess(seconds, TIMEOUT_S + 10, said)
            codes[code] = codes.get(code, 0) + 1
        print(f"{name}: {codes}")
        self.assertGreater(sum(codes.get(code, 0) for code in (INVALID, TOO_LARGE, FAILED)), 0)

    def file(self, name):
        def write(data):
            (self.folder / name).write_bytes(data)
            return self.folder / name
        return write

    def test_nrrd(self):
        self.check("nrrd", self.file("a.nrrd"), nrrd("raw"))

    def test_nrrd_gzip(self):
        self.check("nrrd gzip", self.file("a.nrrd"), nrrd("gzip"))

    def test_meta_image(self):
        self.check("meta image", self.file("a.mha"), meta_image())

    def test_nifti(self):
        self.check("nifti", self.file("a.nii"), nifti())

    def test_nifti_gzip(self):
        self.check("nifti gzip", self.file("a.nii.gz"), gzip.compress(nifti()))

    def test_tiff(self):
        self.check("tiff", self.file("a.tif"), tiff(), ["--spacing-mm", "1,1,1"])

    def test_vdb(self):
        (self.folder / "a.nrrd").write_bytes(nrrd("raw"))
        self.run_import(self.folder / "a.nrrd")
        self.check("vdb", self.file("a.vdb"), self.output.read_bytes())

    def test_dicom(self):
        def write(third):
            shutil.rmtree(self.folder / "series", ignore_errors=True)
            (self.folder / "series").mkdir()
            for z in range(SIZE[2]):
                (self.folder / f"series/{9 - z}.dcm").write_bytes(third if z == 2 else dicom(z))
            return self.folder / "series"
        self.check("dicom", write, dicom(2))


if __name__ == "__main__":
    unittest.main()
