"""A surgeon's afternoon, with the mouse alone: the drill is taken in the window, carves a pit behind
the ear, and what it took is what Python counts."""

import time
import unittest

import numpy as np
import palpate
from support import PATIENCE_S, wait_until
from view_hand_test import HEAD, Led
from view_support import RIGHT, TOOLS, VIEW

# In the view from the left, five steps nearer, with the patient's sides answered.
BEHIND_THE_EAR = np.array((600, 300))
BURR_MM = 3.0  # radius, on the device


@unittest.skipUnless(HEAD.exists(), "no volumes here")
class Story(Led, unittest.TestCase):
    volume = HEAD

    def until(self, holds, what):
        self.assertTrue(wait_until(holds, PATIENCE_S), what)

    def answer_the_sides(self):
        self.window.press("which way does it face?")
        for line, word in (("The face points to", "+y"), ("The head points to", "+z")):
            x, y = self.window.find(line)
            self.window.press(word, within=(x - 100, y + 6, x + 400, y + 36))
        self.window.press("Keep for this file")
        self.until(lambda: self.conn.volume.info().patient_axes == "RAS", "no sides")

    def take_the_drill(self):
        self.window.press("Layers, for everyone")
        self.window.press("Skin and bone")
        self.until(lambda: len(self.conn.settings.layers) == 2, "no layers")
        self.window.press("drill")
        self.window.press("Do so and take it")
        self.until(lambda: self.conn.settings.tool is not None, "no tool")
        self.conn.settings.wait_for_tool()
        # Of the layers, the innermost is felt.
        self.assertEqual((self.conn.settings.layers, self.conn.settings.isovalue), ((), 300.0))
        self.window.press("Let button 0 carve")
        self.until(lambda: self.conn.settings.carve_tool, "button 0 does not carve")

    def values(self):
        """Of all voxels, once the volume is at rest."""
        def rests():
            revision = self.conn.volume.info().volume_revision
            time.sleep(0.6)
            return self.conn.volume.info().volume_revision == revision

        self.until(rests, "the volume changes on")
        return self.conn.volume.download().values.astype(float)

    def carve(self, way):
        """A stroke with the left button. The voxels before and after."""
        before = self.values()
        self.touch(way[0])
        self.window.do("mousedown", 1)
        for place in way:
            self.window.do("mousemove", *(int(number) for number in place))
            self.window.picture()
        self.window.do("mouseup", 1)
        after = self.values()
        self.assertGreater((after != before).sum(), 20)
        # It only takes away.
        self.assertTrue((after <= before).all())
        return before, after

    def turn(self):
        """Alt and a move turn the drill; alt let go leaves it where it is."""
        before = self.pose()
        self.window.do("keydown", "alt", "mousemove_relative", 60, 40)
        self.window.picture()
        self.window.do("keyup", "alt")
        self.window.picture()

        def turned():
            now = self.pose()
            cosine = abs(np.dot(now.stylus_orientation[-1], before.stylus_orientation[-1]))
            return cosine < np.cos(0.1)

        self.until(turned, "the drill does not turn")
        self.assertLess(np.linalg.norm(self.pose().hip_mm[-1] - before.hip_mm[-1]), 1.0)

    def check_reach(self, path, loaded, carved):
        """All that was taken is within the burr's reach, on the way that the recording tells."""
        recording = palpate.open_recording(path)
        ticks = recording.ticks
        np.testing.assert_array_equal(recording.voxels(ticks.tick[-1], loaded), carved)
        info = self.conn.volume.info()
        taken = np.argwhere(carved != loaded)
        taken_mm = taken @ info.device_from_index[:3, :3].T + info.device_from_index[:3, 3]
        edge_mm = np.linalg.norm(info.device_from_index[:3, :3], axis=0).max()
        way_mm = ticks.scp_h_mm[(ticks.buttons & 1) != 0][::5]
        nearest_mm = np.min(np.linalg.norm(taken_mm[:, None] - way_mm[None], axis=2), axis=1)
        # It fades out over 0.75 voxels beyond the ball, and carves 1.5 ahead.
        self.assertLess(nearest_mm.max(), BURR_MM + 2.25 * edge_mm + 0.2)

    def test_the_story(self):
        loaded = self.conn.volume.download().values.astype(float)
        # Room for the whole panel of the session.
        self.window.press("Feel, for everyone", within=RIGHT)
        self.answer_the_sides()
        self.take_the_drill()
        self.window.do("mousemove", *VIEW, "key", "3")
        self.window.picture()
        self.window.press("Record")
        self.until(lambda: self.conn.recording.state().running, "no recording")
        self.take()
        _, first = self.carve([BEHIND_THE_EAR, BEHIND_THE_EAR + (4, 0)])
        self.turn()
        _, second = self.carve([BEHIND_THE_EAR, BEHIND_THE_EAR + (0, 6)])
        self.window.press("Undo")
        self.until(lambda: (self.values() == first).all(), "the second stroke stays")
        self.window.press("End recording")
        self.until(lambda: not self.conn.recording.state().running, "the recording goes on")
        self.assertTrue(((second != loaded) | (first == loaded)).all())
        self.check_reach(self.daemon.folder / "trial.mcap", loaded, first)
        # Measured across the pit.
        self.window.press("Measure (M)", within=TOOLS)
        for place in BEHIND_THE_EAR - (30, 0), BEHIND_THE_EAR + (30, 0):
            self.window.click(*place)
            self.window.picture()
        self.window.press("Replay")
        self.until(lambda: self.conn.volume.info().replayed, "no replay")
        self.window.press("Live again")
        self.until(lambda: not self.conn.volume.info().replayed, "the replay goes on")
        self.window.press("STOP FORCES (Esc)")
        self.until(lambda: self.conn.device.info().forces.state == palpate.ForceState.STOPPED,
                   "the forces are on")


if __name__ == "__main__":
    unittest.main()
