"""Recordings that an earlier version made, one for each kind of change, are read as the same ticks,
and replay to the same bits."""

import dataclasses
import hashlib
import os
import pathlib
import re
import subprocess
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


class KeptRecordings(unittest.TestCase):
    def test_each_gives_the_same_bits(self):
        self.assertEqual({path.stem for path in FOLDER.glob("*")}, set(FIGURES))
        for name, (ticks, bits, compared, scenes, edits) in FIGURES.items():
            with self.subTest(name):
                file = FOLDER / f"{name}.mcap"
                recording = palpate.open_recording(file)
                self.assertTrue(recording.complete, recording.ends_early)
                self.assertEqual((len(recording.ticks), digest(recording.ticks)), (ticks, bits))
                self.assertEqual([(marker.tick, marker.text) for marker in recording.markers],
                                 [(1434, "a marker")] if name == "settings" else [])
                said = subprocess.run([os.environ["PALPATE_LAB"], "replay", "--recording", file],
                                      check=True, capture_output=True, text=True).stdout
                figures = dict(re.findall(r"^(\w+) +(\d+)", said, re.M))
                self.assertEqual({key: int(figures[key]) for key in (
                    "ticks", "compared", "differing", "scenes", "edits")}, {
                    "ticks": ticks, "compared": compared, "differing": 0, "scenes": scenes,
                    "edits": edits})


if __name__ == "__main__":
    unittest.main()
