"""What clients are shown in a replay, and what their calls do meanwhile."""

import json
import unittest

import numpy as np

import palpate
from replayed import LAYERS, TOOL, differences, record, scene_at, standing
from support import METHODS, Daemon, nrrd, wait_until

TICKS = 50


class ReplayTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(Daemon("builtin:gyroid:48"))
        cls.conn = cls.enterClassContext(cls.daemon.connect())
        cls.file = cls.daemon.folder / "a.mcap"
        cls.recording = record(cls.conn, cls.file)
        cls.live = cls.conn.settings.all()

    def test_all_clients_are_shown_the_scene_of_the_tick(self):
        recorded = self.recording.ticks
        facts = self.conn.facts()
        places = np.random.default_rng(1).integers(0, len(recorded.tick) - 1, TICKS)
        seen = set()
        loaded = self.conn.volume.download().values
        live_place = self.conn.volume.place()
        for place in places.tolist():
            scene = scene_at(self.recording, place)
            with self.subTest(place=place), standing(self.daemon, self.file, place) as pose:
                # Facts are looked at one after the other.
                told = next(one for one in facts
                            if one.replayed and one.volume.replayed
                            and one.settings_revision == pose.settings_revision[-1]
                            and one.volume.volume_revision == pose.volume_revision[-1]
                            and np.array_equal(one.volume.device_from_index,
                                               scene.device_from_index))
                info = json.loads(self.daemon.palpate("info", "--json").stdout)
                ours = (self.conn.settings.all(), self.conn.volume.info().device_from_index)
                self.assertEqual(differences(scene, *ours), [])
                self.assertEqual(differences(scene, told.settings, told.volume.device_from_index),
                                 [])
                self.assertTrue(self.conn.settings.replayed and self.conn.volume.info().replayed)
                self.assertTrue(info["settings"]["replayed"] and info["volume"]["replayed"])
                for name in ("isovalue", "stiffness_n_per_mm", "tool_radius_mm", "free_side",
                             "refinement"):
                    self.assertEqual(info["settings"][name], scene.settings[name])
                self.assertEqual([layer["name"] for layer in info["settings"]["layers"]],
                                 [layer.name for layer in scene.settings["layers"]])
                self.assertEqual(info["settings"]["tool"]["name"],
                                 scene.settings["tool"].name if scene.settings["tool"] else "")
                np.testing.assert_array_equal(
                    np.reshape(info["volume"]["device_from_index"]["linear"], (3, 3)),
                    scene.device_from_index[:3, :3])
                self.assertEqual(self.conn.settings.ball().felt_radius_mm,
                                 recorded.tool_radius_mm[place])
                copy = self.conn.volume.download()
                self.assertTrue(copy.replayed)
                np.testing.assert_array_equal(copy.values,
                                              self.recording.voxels(recorded.tick[place], loaded))
                self.assertEqual(pose.volume_revision[-1], copy.volume_revision)
                seen.add((len(scene.settings["layers"]), scene.settings["tool"] == TOOL,
                          scene.settings["tool_radius_mm"], scene.settings["free_side"]))
        self.assertGreaterEqual(len(seen), 5)
        # The live ones again, to all who follow, with revisions that are new to them.
        self.assertTrue(wait_until(lambda: not self.conn.settings.replayed))
        told = next(one for one in facts if not one.replayed and not one.volume.replayed)
        self.assertEqual((told.settings, self.conn.settings.all()), (self.live, self.live))
        self.assertGreater(told.settings_revision, pose.settings_revision[-1])
        np.testing.assert_array_equal(self.conn.volume.place().center_mm, live_place.center_mm)
        np.testing.assert_array_equal(self.conn.volume.download().values, loaded)

    def test_the_recorded_voxels_are_shown_in_place_of_unsaved_edits(self):
        loaded = self.conn.volume.download().values
        self.conn.edit.sphere((0.0, 0.0, 0.0), 6.0, "set", 0.7)
        self.addCleanup(self.conn.edit.revert)
        edited = self.conn.volume.download().values
        self.assertFalse(np.array_equal(edited, loaded))
        with standing(self.daemon, self.file, 0):
            np.testing.assert_array_equal(
                self.conn.volume.download().values,
                self.recording.voxels(self.recording.ticks.tick[0], loaded))
        self.assertTrue(wait_until(lambda: not self.conn.volume.info().replayed))
        np.testing.assert_array_equal(self.conn.volume.download().values, edited)

    def test_each_call_does_what_the_table_says(self):
        """Refused with a reason and without an effect, or done and kept, or of the replay."""
        before = (self.live, self.conn.volume.place().center_mm.tolist(),
                  self.conn.volume.download().values)
        saved = self.daemon.folder / "saved.nrrd"
        sphere = {"center": (0, 0, 0), "radius": 5.0, "operation": "set", "value": 0.5}
        refused = {
            "UpdateSettings": [lambda c: c.settings.update(**change) for change in (
                {"isovalue": 0.5}, {"layers": LAYERS}, {"layers": ()}, {"tool_radius_mm": 1.0},
                {"refinement": 3}, {"free_side": "above"}, {"tool": TOOL})],
            "UpdateRegistration": [lambda c: c.volume.place(move_mm=(5, 0, 0))],
            "EditVolume": [lambda c: c.edit.sphere(*sphere.values())],
            "UndoEdit": [lambda c: c.edit.undo()], "RedoEdit": [lambda c: c.edit.redo()],
            "RevertVolume": [lambda c: c.edit.revert()],
            "FilterVolume": [lambda c: c.edit.filter("mean")],
            "LoadVolume": [lambda c: c.volume.load("builtin:bumps:32")],
            "UploadVolume": [lambda c: c.volume.upload(np.zeros((9, 9, 9), np.uint8) + 1)],
            "LoadSeries": [lambda c: c.series.load(["/no.nrrd", "/none.nrrd"])],
            "ControlSeries": [lambda c: c.series.pause()],
            "StartRecording": [lambda c: c.recording.start(self.daemon.folder / "b.mcap")],
            "PushHand": [lambda c: c.device.push((0.1, 0, 0), 0.1)],
        }
        kept = {
            "SaveVolume": lambda c: c.volume.save(saved),
            "StopForces": lambda c: c.device.stop(), "DisableForces": lambda c: c.device.disable(),
            "EnableForces": lambda c: c.device.enable(),
        }
        with standing(self.daemon, self.file, 300):
            for name, calls in refused.items():
                for call in calls:
                    with self.subTest(call=name), self.assertRaises(palpate.Conflict) as refusal:
                        call(self.conn)
                    self.assertIn("replay", str(refusal.exception), name)
            for call in kept.values():
                call(self.conn)
            with self.conn.device.lead() as hand:
                hand.move_to((1, 2, 3))
            for call in (lambda: self.conn.recording.mark("a"), self.conn.recording.stop,
                         lambda: self.conn.recording.replay(self.file)):
                self.assertRaises(palpate.Conflict, call)
            self.assertRaises(palpate.InvalidArgument, self.conn.device.calibrate)
            self.assertEqual(self.conn.end_caller("token nobody"), 0)
            self.assertRaises(palpate.Conflict, self.conn.series.state)  # none is loaded
            self.assertTrue(self.conn.settings.replayed)
        after = (self.conn.settings.all(), self.conn.volume.place().center_mm.tolist(),
                 self.conn.volume.download().values)
        self.assertEqual(after[:2], before[:2])
        np.testing.assert_array_equal(after[2], before[2])
        self.assertEqual(self.conn.volume.info().unsaved_edits, 0)
        self.assertFalse((self.daemon.folder / "b.mcap").exists())
        self.assertTrue(wait_until(lambda: self.conn.device.info().forces.state == "on"))
        with Daemon(saved) as other, other.connect() as conn:
            np.testing.assert_array_equal(conn.volume.download().values, before[2])
        # Each method that changes what is felt is among them.
        questions = {"GetActivity", "GetDevice", "GetRecording", "GetRegistration", "GetSeries",
                     "GetSettings", "GetVolume", "ListDevices", "ListRecordings", "StreamPoses",
                     "StreamVolume"}
        others = {"CalibrateDevice", "EndCaller", "LeadHand", "Mark", "Replay", "StopRecording"}
        self.assertEqual({method.name for method in METHODS},
                         questions | others | set(refused) | set(kept))

    def test_a_series_is_shown_where_it_was(self):
        files = [self.daemon.folder / f"t{n}.nrrd" for n in range(4)]
        for n, path in enumerate(files):
            path.write_bytes(nrrd(np.full((16, 16, 16), n, np.uint8) + np.arange(16, dtype=np.uint8)))
        file = self.daemon.folder / "series.mcap"
        with Daemon("builtin:gyroid:32", more=["--save-folder", str(self.daemon.folder)],
                    config={"volume": ['load_folders = ["/"]']}) as daemon, daemon.connect() as conn:
            conn.series.load(files)
            conn.recording.start(file)
            for position in (1.0, 2.0, 3.0, 0.0):
                conn.series.seek(position)
                end = conn.recording.state().ticks + 100
                wait_until(lambda: conn.recording.state().ticks >= end)
            conn.recording.stop()
            conn.series.configure(loop=True)
            conn.series.play(10)
            positions = palpate.open_recording(file).ticks.series_position_frames
            for place in range(50, len(positions) - 1, 40):
                with standing(daemon, file, place):
                    state = conn.series.state()
                    self.assertTrue(state.replayed and not state.playing)
                    self.assertEqual(state.position_frames, positions[place])
                    values = conn.volume.download().values
                    self.assertEqual(values[0, 0, 0], positions[place])
            self.assertTrue(conn.series.state().playing)


if __name__ == "__main__":
    unittest.main()
