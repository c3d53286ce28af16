"""What `palpate` does to a daemon's volume: edits, saves, uploads, downloads, series
and places. Its other
commands: tests/cli."""

import json
import shlex
import unittest

import numpy as np

from calls import CallsTest
from support import nrrd, pattern


class Commands(CallsTest):
    config = "[volume]\nmax_upload_mib = 1\n"

    def palpate(self, line, code=0):
        """What it prints; of --json, the values. `@` is the daemon's folder."""
        ran = self.daemon.palpate(
            *shlex.split(line.replace("@", f"{self.daemon.folder}/")), code=code)
        if code:
            self.assertEqual(ran.stderr.count("palpate: "), 1, ran.stderr)
        return json.loads(ran.stdout) if "--json" in line and not code else ran.stdout

    def refuse(self, lines):
        for line, code in lines.items():
            with self.subTest(line):
                self.palpate(line, code)

    def test_edits_are_made_taken_back_and_saved(self):
        self.palpate("load builtin:bumps:64")
        edited = self.palpate("edit box --min-voxels 10,10,10 --max-voxels 12,12,12 "
                              "--operation set --value 0.75 --json")
        self.assertEqual((edited["changed_voxels"], edited["changed"]["max"]), (27, [12, 12, 12]))
        self.palpate("edit capsule --from-mm -1,2,3 --to-mm 9,2,3 --radius-mm 2 --falloff-mm 1 "
                     "--operation paint --value 1 --strength .5")
        self.assertEqual(self.palpate("undo --json")["redo_steps"], 1)
        self.assertEqual(self.palpate("redo --json")["undo_steps"], 2)
        self.palpate("undo --expected-revision 1", 7)
        self.palpate("revert")
        np.full(8, 0.125, np.float32).tofile(self.daemon.folder / "block.f32")
        self.assertEqual(self.palpate("edit block @block.f32 --min-voxels 1,2,3 --size-voxels "
                                      "2,2,2 --operation set --json")["changed"]["min"], [1, 2, 3])
        saved = self.palpate("save @a.nrrd --json")
        self.assertEqual(saved["size_bytes"], (self.daemon.folder / "a.nrrd").stat().st_size)
        self.palpate("save @a.nrrd", 7)
        self.palpate("save @a.nrrd --overwrite")

    def test_edits_that_make_no_sense(self):
        sphere = "edit sphere --center-voxels 9,9,9 "
        block = "edit block /none --operation set --size-voxels 2,2,2 --min-voxels "
        self.palpate(sphere + "--radius-voxels 2 --operation set --value 0.5")
        self.refuse({sphere + end: code for end, code in {
            "--radius-mm 2 --operation set --value 0.5": 2, "--operation set --value 0.5": 2,
            "--radius-voxels 2 --operation set": 2, "--radius-voxels 2 --value 0.5": 2,
            "--radius-voxels 2 --operation cut --value 0.5": 2,
            "--radius-voxels 2 --operation smooth --value 0.5": 2,
            "--radius-voxels nan --operation smooth": 2,
            "--radius-voxels 2 --operation smooth --strength 2": 2,
            "--radius-voxels -2 --operation smooth": 3}.items()}
            | {"edit": 2, block + "1,1,1": 4, block + "-1,1,1": 2})

    def test_files_are_sent(self):
        file = self.daemon.folder / "sent.nrrd"
        file.write_bytes(nrrd(pattern((9, 8, 7))))
        self.palpate("upload @sent.nrrd --normalized-isovalue 0.25")
        self.assertEqual(self.conn.volume.info().source, "upload:sent.nrrd")
        (self.daemon.folder / "empty.nrrd").touch()
        (self.daemon.folder / "large.nrrd").write_bytes(bytes((1 << 20) + 1))
        self.refuse({"upload": 2, "upload @absent.nrrd": 4, "upload @": 3, "upload @empty.nrrd": 3,
                     "upload @large.nrrd": 6})
        np.arange(48, dtype=np.uint8).tofile(self.daemon.folder / "b.dat")
        self.palpate("upload @b.dat --raw-size 4,4,3 --raw-type uint8")
        self.assertEqual(self.conn.volume.info().shape, (4, 4, 3))

    def test_what_is_downloaded_is_the_volume_with_its_edits(self):
        self.conn.volume.upload(pattern((20, 21, 22)), (0.5, 1, 2))
        self.conn.edit.sphere((9, 9, 9), 5, "set", 7.0, frame="index")
        volume = self.conn.volume.download()
        self.assertIn(str(volume.volume_revision), self.palpate("download @copy.nrrd"))
        self.conn.volume.load(self.daemon.folder / "copy.nrrd")
        again = self.conn.volume.download()
        np.testing.assert_array_equal(again.values, volume.values)
        np.testing.assert_allclose(again.world_from_index, volume.world_from_index, atol=1e-12)
        self.refuse({"download @copy.nrrd": 7, "download @missing/copy.nrrd": 4,
                     f"download {self.daemon.folder}": 3})
        self.palpate("download @copy.nrrd --overwrite")

    def test_a_series_plays(self):
        for n in range(3):
            (self.daemon.folder / f"t{8 + n}.nrrd").write_bytes(
                nrrd(pattern((9, 8, 7)) + n))
        self.palpate("series load @t*.nrrd")
        for line in ("rate -.5", "loop on", "interpolate on", "seek 1.5", "play"):
            self.palpate("series " + line)
        told = self.palpate("series info --json")
        self.assertEqual([told[key] for key in ("frames", "playing", "rate_hz", "loop",
                                                "interpolate")], [3, True, -0.5, True, True])
        self.palpate("series pause")
        self.assertFalse(self.palpate("series info --json")["playing"])
        self.refuse({"series seek 7": 3} | {f"series {line}": 2 for line in (
            "", "load", "seek", "seek x", "rate", "loop", "loop maybe", "play x", "stop")})
        self.palpate("load builtin:sphere:16")
        self.palpate("series info", 7)

    def test_a_place_is_given_and_shown(self):
        self.palpate("load builtin:bumps:32")
        placed = self.palpate("place --center-mm -.5,1,0 --turn-deg z,-90 --cells-per-mm 4 --json")
        self.assertEqual((placed["center_mm"], placed["device_mm_per_voxel"]), ([-0.5, 1, 0], 0.25))
        self.assertAlmostEqual(placed["rotation_wxyz"][3], -np.sqrt(0.5))
        self.assertGreater(placed["applied_tick"], 0)
        shown = self.palpate("place --json")
        self.assertEqual(shown["settings_revision"], placed["settings_revision"])
        self.refuse({"place --device-mm-per-voxel 1e7": 3,
                     "place --reset --expected-revision 1": 7})
        self.palpate("place --reset")
        self.assertEqual(self.palpate("place --json")["center_mm"], [0, 0, 0])


if __name__ == "__main__":
    unittest.main()
