"""Damaged files of every format through palpate-import: each is a volume or a refusal of
one line, within its limit of memory, and nothing is left where it was refused.

The import tests damage headers of known files; here every byte may change. OpenVDB trusts its
files: a crash of the reader is caught. A fixed seed; PALPATE_TORTURE times as many files in the
long run."""

import gzip
import os
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

from dicom_series import dicom_slice
from support import SANITIZED

sys.path.append(str(pathlib.Path(__file__).parents[1] / "fuzz"))
import corpus_images  # noqa: E402

IMPORT = pathlib.Path(os.environ["PALPATED"]).with_name("palpate-import")
# Of each format. Twice as many took 20 minutes in the long run.
FILES = 10 * int(os.environ.get("PALPATE_TORTURE", "1"))
MEMORY_MIB = 512
# The importer's own code and libraries.
BASE_MIB = 300
TIMEOUT_S = 20
WRITTEN, FAILED, INVALID, NOT_FOUND, TOO_LARGE = 0, 1, 3, 4, 6


def damaged(data, rng):
    """Half of it where the header is, and the topology of a .vdb file."""
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        place = rng.randrange(len(data)) if rng.random() < 0.5 else rng.randrange(
            min(len(data), rng.choice((400, 3000))))
        kind = rng.random()
        if kind < 0.5:
            data[place] ^= 1 << rng.randrange(8)
        elif kind < 0.7:  # what may be a length
            number = rng.choice((b"9999", b"\x7f" + b"\xff" * 7, *(struct.pack("<q", n) for n in (
                0, 1, -1, 0x7fffffff, 0x80000000, 0x10000, 1 << 40, 1 << 62))))
            number = number[:rng.choice((4, 8))]
            data[place:place + len(number)] = number
        elif kind < 0.8:
            size = rng.choice((1, 7, 400))
            data[place:place] = rng.choice((rng.randbytes(size), data[-size:]))
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
        """(exit code, stderr, MiB)"""
        self.output.unlink(missing_ok=True)
        with open(self.folder / "stderr", "w+b") as said:
            process = subprocess.Popen(
                [IMPORT, source, self.output, "--max-memory-mib", str(MEMORY_MIB), "--timeout-s",
                 str(TIMEOUT_S), *options], stdout=subprocess.DEVNULL, stderr=said)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            process.poll()  # says whether it crashed
            said.seek(0)
            text = said.read().decode(errors="replace")
        return process.returncode, text, usage.ru_maxrss / 1024

    def check(self, name, write, seed, options=()):
        """Of files that `write` writes: whole as they are, and damaged."""
        source = write(seed)
        code, text, _ = self.run_import(source, options)
        self.assertEqual(code, WRITTEN, f"{name} is no seed: {text}")
        rng, codes = random.Random(f"{name} 8"), {}
        allowed = {WRITTEN, INVALID, TOO_LARGE, FAILED}
        if name.endswith((".nrrd", ".mha")):
            allowed.add(NOT_FOUND)  # the header names another file
        for number in range(FILES):
            source = write(damaged(seed, rng))
            code, text, mib = self.run_import(source, options)
            said = f"{name} {number}: {code} {text}"
            lines = [line for line in text.splitlines() if ": warning: " not in line]
            # Readers that are not ours may crash: the importer says so itself.
            self.assertIn(code, allowed, said)
            if SANITIZED and "requested allocation size" in text:
                continue  # new throws elsewhere: AddressSanitizer ends the program
            self.assertNotIn("Sanitizer", text, said)
            if code == FAILED:
                self.assertRegex(text, "the reader( of [A-Za-z]+)? crashed", said)
            if code != WRITTEN:
                self.assertEqual(len(lines), 1, said)
                self.assertFalse(self.output.exists(), said)
            if not SANITIZED:
                self.assertLess(mib, MEMORY_MIB + BASE_MIB, said)
            codes[code] = codes.get(code, 0) + 1
        print(f"{name}: {codes}")
        self.assertGreater(FILES - codes.get(WRITTEN, 0), FILES // 10)

    def check_file(self, name, seed, options):
        def write(data):
            (self.folder / name).write_bytes(data)
            return self.folder / name
        with self.subTest(name):
            self.check(name, write, seed, options)

    def test_files(self):
        nrrds, nifti = corpus_images.nrrds(), corpus_images.nifti1()
        (self.folder / "seed.nrrd").write_bytes(nrrds["lps"])
        self.run_import(self.folder / "seed.nrrd")
        for name, seed in {"lps.nrrd": nrrds["lps"], "gzip.nrrd": nrrds["gzip"],
                           "a.mha": corpus_images.meta_image(), "a.nii": nifti,
                           "a.nii.gz": gzip.compress(nifti), "a.vdb": self.output.read_bytes(),
                           "a.tif": corpus_images.tiffs()["two_pages"]}.items():
            self.check_file(name, seed,
                            ["--spacing-mm", "1,1,1"] if name.endswith("tif") else [])

    def test_vdb_files(self):
        for kind in ("cloud", "sphere", "uint8", "bool", "vector"):
            path = self.folder / f"{kind}.vdb"
            subprocess.run([os.environ["PALPATE_VDB_TOOL"], "make", kind, "24", path], check=True)
            self.check_file(path.name, path.read_bytes(),
                            ["--component", "x"] if kind == "vector" else [])

    def test_dicom(self):
        def write(third):
            shutil.rmtree(self.folder / "series", ignore_errors=True)
            (self.folder / "series").mkdir()
            for z in range(4):
                (self.folder / f"series/{9 - z}.dcm").write_bytes(third if z == 2 else slices[z])
            return self.folder / "series"
        slices = [dicom_slice(z, 4, 3, corpus_images.SHORTS[:24]) for z in range(4)]
        self.check("dicom", write, slices[2])


if __name__ == "__main__":
    unittest.main()
