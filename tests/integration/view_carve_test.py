"""A surgeon's afternoon, with the mouse alone: the drill is taken in the window, carves a pit behind
the ear, and what it took is what Python counts."""

import pathlib
import time
import unittest

import numpy as np
import palpate
from support import PATIENCE_S, wait_until
from view_hand_test import HEAD, Led
from view_support import STATE, TOOLS, VIEW

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

    def carve(self, places):
        """A stroke with the left button; the voxels that it changed, once all have come."""
        before = self.conn.volume.download().values
        self.touch(places[0])
        self.window.do("mousedown", 1)
        for place in places:
            self.window.do("mousemove", *(int(number) for number in place))
            self.window.picture()
        self.window.do("mouseup", 1)
        self.until(lambda: self.window.shows("Undo", within=None) and
                   self.at_rest(), "carving goes on")
        return self.conn.volume.download().values != before

    def at_rest(self):
        revision = self.conn.volume.info().volume_revision
        time.sleep(0.6)
        return self.conn.volume.info().volume_revision == revision
