"""The stylus in the hand of who has a mouse: the pointer over a window leads it, seen by another
client, in pictures and in a recording."""

import os
import pathlib
import re
import subprocess
import time
import unittest

import numpy as np
import palpate
from support import PATIENCE_S, Client, Daemon, wait_until
from palpate.v1 import device_pb2
from view_support import Screen, Window

PALPATE_LAB = os.environ["PALPATE_LAB"]
HEAD = pathlib.Path(os.environ["PALPATE_DATA_DIR"]) / (
    "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd")
# The middle of the view, in a window of 1280 by 800 pixels.
MIDDLE = np.array((640, 329))
FORCE_PLOT = "Force, N"
WAY_PX = 60
# Of HIP, between the pointer's places.
LEAST_MM = 5.0


class Led:
    """A daemon, another client, and a window."""

    volume, arguments = "builtin:sphere:48", ()

    def setUp(self):
        self.daemon = self.enterContext(Daemon(self.volume, more=self.arguments))
        self.conn = self.enterContext(self.daemon.connect())
        self.client = Client(self.daemon)
        self.addCleanup(self.client.channel.close)
        self.window = Window(self.enterContext(Screen()), self.daemon.folder, "--socket",
                             self.daemon.socket)
        self.addCleanup(self.window.end)
        self.window.wait_for_title(f"Palpate: {pathlib.Path(self.volume).name}")

    def leader(self):
        return self.client.device.GetDevice(device_pb2.GetDeviceRequest()).hand_led_by

    def take(self):
        self.window.do("mousemove", *MIDDLE)
        # The window learns of the device a moment after it has the volume.
        self.window.do("key", "g")
        self.assertTrue(wait_until(self.leader), "nobody leads the hand")

    def pose(self):
        with self.conn.poses() as stream:
            return next(stream)

    def touch(self, place, last_mm=np.inf):
        """The pose when the hand rests in contact with the pointer there, away from the last place."""
        self.window.do("mousemove", *(int(number) for number in place))
        seen = {}

        def rests():
            # Drawn after the pointer was seen. Around a volume, the hand stops until the next frame.
            self.window.picture()
            now = seen["pose"] = self.pose()
            before = seen.setdefault("before", now)
            if now.tick[-1] < before.tick[-1] + 100:
                return False
            seen["before"] = now
            # A loaded machine may take its time until the hand leaves the last place.
            return (before.contact[-1] and now.contact[-1] and
                    np.linalg.norm(now.hip_mm[-1] - last_mm) > LEAST_MM and
                    np.linalg.norm(now.hip_mm[-1] - before.hip_mm[-1]) < 0.02)

        self.assertTrue(wait_until(rests), f"the hand does not come to rest at {place}")
        return seen["pose"]

    def drag(self):
        """Poses of all ticks while the pointer goes across the volume, and where it rested."""
        rests = []
        with self.conn.poses(rate_hz=1000, batch=50, waiting=1000) as stream:
            # Until the window has the surface, the hand stays where it was taken.
            last_mm = self.touch(MIDDLE).hip_mm[-1]
            for step in (-1, 0, 1):
                rests.append(self.touch(MIDDLE + (step * WAY_PX, 0), last_mm))
                last_mm = rests[-1].hip_mm[-1]
            last = rests[-1].tick[-1]
            batches = []
            for batch in stream:
                batches.append(batch)
                if batch.tick[-1] >= last:
                    break
        first = rests[0].tick[-1]
        ticks = np.concatenate([batch.tick for batch in batches])

        def column(name):
            return np.concatenate([getattr(batch, name) for batch in batches])[ticks >= first]

        return rests, column

    def check_touch(self):
        rests, column = self.drag()
        hips = [rest.hip_mm[-1] for rest in rests]
        # To the right, with the pointer.
        to_right = hips[2] - hips[0]
        for from_mm, to_mm in zip(hips, hips[1:]):
            self.assertGreater(np.dot(to_mm - from_mm, to_right), 0.0)
            self.assertGreater(np.linalg.norm(to_mm - from_mm), LEAST_MM)
        contact = column("contact")
        self.assertGreater(contact.mean(), 0.5)
        side = np.where(column("free_side") == palpate.FreeSide.ABOVE, -1.0, 1.0)
        inside = side * (column("density") - column("isovalue"))
        info = self.conn.volume.info()
        self.assertLess(inside.max(), 1e-6 * (info.value_max - info.value_min))
        # How deep the hand rests depends on its way: a head has many hollows. The force is that of
        # the spring wherever it rests, and somewhere more than the step of a coarse encoder makes.
        for rest in rests:
            spring = rest.scp_h_mm[-1] - rest.hip_mm[-1]
            along = np.dot(rest.force_n[-1], spring)
            self.assertGreater(along, 0.99 * np.linalg.norm(rest.force_n[-1]) *
                               np.linalg.norm(spring))
        self.assertGreater(np.linalg.norm(column("force_n"), axis=1).max(), 0.03)

    def replay(self, path):
        ran = subprocess.run([PALPATE_LAB, "replay", "--recording", path], capture_output=True,
                             text=True, timeout=PATIENCE_S, check=False)
        self.assertEqual(ran.returncode, 0, ran.stdout + ran.stderr)
        figures = dict(re.findall(r"^ *([a-z]+) +(\d+)", ran.stdout, re.MULTILINE))
        self.assertEqual(figures["differing"], "0")
        self.assertGreater(int(figures["compared"]), 100)


class ViewHand(Led, unittest.TestCase):
    def plot(self):
        """The curve of the force, below its name."""
        x, y = self.window.find(FORCE_PLOT)
        return np.asarray(self.window.picture())[y + 12:y + 42, x:x + 100]

    def test_a_drag_across_the_volume_is_felt_and_recorded(self):
        path = self.daemon.folder / "hand.mcap"
        if not self.window.shows(FORCE_PLOT):
            self.window.do("key", "d")
        before = self.plot()
        # Without the plots, the view has its middle where the pointer goes.
        self.window.do("key", "d")
        self.take()
        self.conn.recording.start(path)
        self.check_touch()
        self.conn.recording.stop()
        self.window.do("key", "d")
        self.assertFalse(np.array_equal(before, self.plot()))
        self.replay(path)

    def test_the_wheel_presses_and_lifts(self):
        self.take()
        light = self.touch(MIDDLE)
        self.window.do("click", "--repeat", 6, 4)
        self.assertTrue(wait_until(lambda: np.linalg.norm(self.pose().force_n[-1]) >
                                   1.5 * np.linalg.norm(light.force_n[-1])))
        self.window.do("click", "--repeat", 30, 5)
        self.assertTrue(wait_until(lambda: not self.pose().contact[-1]))

    def test_the_hand_is_given_back_and_taken_by_one_at_a_time(self):
        self.take()
        self.window.do("key", "g")
        self.assertTrue(wait_until(lambda: not self.leader()))
        other = Window(self.enterContext(Screen()), self.daemon.folder, "--socket",
                       self.daemon.socket)
        self.addCleanup(other.end)
        other.wait_for_title("Palpate: builtin:sphere:48")
        self.take()
        leader = self.leader()
        other.do("mousemove", *MIDDLE)

        def is_refused():
            # Each picture replaces the line by one of its own, so the line must be there first.
            other.do("key", "g")
            time.sleep(2)
            return other.shows("wait until they give it back")

        self.assertTrue(wait_until(is_refused))
        self.assertEqual(self.leader(), leader)


@unittest.skipUnless(HEAD.exists(), "no volumes here")
class ViewHandHead(Led, unittest.TestCase):
    volume, arguments = HEAD, ("--isovalue", "300")

    def test_a_drag_across_a_head_is_felt_and_recorded(self):
        path = self.daemon.folder / "hand.mcap"
        self.take()
        self.conn.recording.start(path)
        self.check_touch()
        self.conn.recording.stop()
        self.replay(path)


if __name__ == "__main__":
    unittest.main()
