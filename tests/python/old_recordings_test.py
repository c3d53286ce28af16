"""Recordings that the last version without MCAP made, one for each kind of change, convert to the
same ticks, and replay to the same bits. version_5 and version_2: the same in older formats."""

import dataclasses
import hashlib
import os
import pathlib
import re
import subprocess
import tempfile
import unittest

import palpate

FOLDER = pathlib.Path(__file__).parents[1] / "data" / "recordings"
# By that version: ticks, and a digest of all their columns; ticks that palpate-lab replay compared,
# scenes and edits.
FIGURES = {
    "edits": (207, "478a569ae5349356", 178, 5, 4),
    "load": (434, "ad329467192d1731", 414, 2, 0),
    "place": (170, "ea1b498abd868392", 110, 3, 0),
    "series": (328, "fff260369030699a", 315, 3, 3),
    "settings": (195, "f0cc3972b03847d3", 146, 3, 0),
    "settings_version_2": (195, "f0cc3972b03847d3", 146, 3, 0),
    "settings_version_5": (195, "f0cc3972b03847d3", 146, 3, 0),
    "upload": (136, "b09fe257c75af030", 118, 2, 2)}
# What ticks have had since.
LATER = {"replayed", "led_target_mm", "series_position_frames", "refinement", "layers_passed",
         "contact_layer", "tool_radius_mm", "hand", "torque_n_mm", "force_torque_limit_n_mm",
         "push_n", "tool_orientation", "touching_balls"}


def digest(ticks):
    joined = hashlib.sha256()
    for name in sorted({field.name for field in dataclasses.fields(ticks)} - LATER):
        joined.update(name.encode() + getattr(ticks, name).tobytes())
    return joined.hexdigest()[:16]


class OldRecordings(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def lab(self, *arguments, code=0):
        done = subprocess.run([os.environ["PALPATE_LAB"], *arguments], capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stdout, done.stderr

    def test_each_gives_the_same_bits(self):
        self.assertEqual({path.stem for path in FOLDER.glob("*")}, set(FIGURES))
        for name, (ticks, bits, compared, scenes, edits) in FIGURES.items():
            with self.subTest(name):
                file = self.folder / f"{name}.mcap"
                self.lab("convert", FOLDER / f"{name}.palrec", "--out", file)
                recording = palpate.open_recording(file)
                self.assertTrue(recording.complete, recording.ends_early)
                self.assertEqual((len(recording.ticks), digest(recording.ticks)), (ticks, bits))
                self.assertEqual([(marker.tick, marker.text) for marker in recording.markers],
                                 [(1434, "a marker")] if "settings" in name else [])
                self.assertEqual(recording.created_monotonic_ns is None, "version" in name)
                said, _ = self.lab("replay", "--recording", file)
                figures = dict(re.findall(r"^(\w+) +(\d+)", said, re.M))
                self.assertEqual({key: int(figures[key]) for key in (
                    "ticks", "compared", "differing", "scenes", "edits")}, {
                    "ticks": ticks, "compared": compared, "differing": 0, "scenes": scenes,
                    "edits": edits})

    def test_what_is_damaged_or_new_is_said(self):
        old, file = FOLDER / "edits.palrec", self.folder / "a.mcap"
        data = old.read_bytes()
        (self.folder / "cut.palrec").write_bytes(data[:len(data) // 2])
        _, said = self.lab("convert", self.folder / "cut.palrec", "--out", file)
        self.assertIn("chunk", said)
        recording = palpate.open_recording(file)
        self.assertIn("not closed", recording.ends_early)
        self.assertTrue(0 < len(recording.ticks) < 207)
        self.lab("convert", old, "--out", file, code=7)  # it exists
        self.lab("convert", file, "--out", self.folder / "b.mcap", code=3)  # it is new
        self.assertIn("convert", self.lab("export", old, code=3)[1])


if __name__ == "__main__":
    unittest.main()
