"""palpate-view in a window: what pointer and keys do, seen by another client."""

import unittest

import numpy as np
import palpate
from support import Daemon, wait_until
from view_support import OneWindow, Screen, Window, run_view

# Of the fixed layout on 1280 by 800 pixels: the histogram, and the middle of the view.
HISTOGRAM_X = (10, 290)
HISTOGRAM_Y = 130
ISOVALUE = (60, 184)  # its number
VIEW = (640, 322)


def histogram_x(share):
    return round(HISTOGRAM_X[0] + share * (HISTOGRAM_X[1] - HISTOGRAM_X[0]))


def mark_x(picture):
    """Middle of the isovalue's mark, a yellow line over the histogram."""
    row = np.asarray(picture)[HISTOGRAM_Y, HISTOGRAM_X[0]:HISTOGRAM_X[1]].astype(int)
    yellow = np.flatnonzero((row[:, 0] > 240) & (row[:, 1] > 220) & (row[:, 2] < 160))
    return HISTOGRAM_X[0] + float(yellow.mean()) if yellow.size else None


class ViewWindow(OneWindow):
    def test_a_dragged_isovalue_is_felt_by_others_while_it_is_dragged(self):
        info = self.conn.volume.info()

        def share():
            extent = info.value_max - info.value_min
            return (self.conn.settings.isovalue - info.value_min) / extent

        self.window.do("mousemove", histogram_x(0.5), HISTOGRAM_Y, "mousedown", 1)
        for wanted in (0.3, 0.7, 0.55):
            self.window.do("mousemove", histogram_x(wanted), HISTOGRAM_Y)
            self.assertTrue(wait_until(lambda at=wanted: abs(share() - at) < 0.01),
                            f"{share()} is not {wanted}")
        self.window.do("mouseup", 1)

    def test_the_slider_follows_other_clients(self):
        info = self.conn.volume.info()
        for share in (0.35, 0.6):
            self.conn.settings.isovalue = info.value_min + share * (info.value_max - info.value_min)
            self.assertTrue(wait_until(
                lambda at=share: abs((mark_x(self.window.picture()) or 0) - histogram_x(at)) <= 2))

    def key_makes(self, key, expected):
        """A key of the history, after which the voxels are these."""
        self.window.do("key", key)
        self.assertTrue(wait_until(
            lambda: np.array_equal(self.conn.volume.download().values, expected)))

    def test_a_stroke_on_the_surface_edits_and_is_taken_back_as_one(self):
        before = self.conn.volume.download().values
        first = self.revision()
        self.window.do("key", "b")
        x, y = VIEW
        self.window.drag([(x + step, y) for step in range(-40, 41, 5)])
        self.assertTrue(wait_until(lambda: self.revision() > first), "no edit came")
        self.window.do("key", "b")
        changed = {}

        def settled():
            # The last edit of a stroke may still be on its way.
            seen, changed["at"] = changed.get("at"), self.revision()
            changed["values"] = self.conn.volume.download().values
            return seen == changed["at"] and not np.array_equal(changed["values"], before)

        self.assertTrue(wait_until(settled))
        self.key_makes("ctrl+z", before)
        self.key_makes("ctrl+y", changed["values"])
        self.key_makes("ctrl+z", before)

    def settings_revision(self):
        with self.conn.poses() as stream:
            return int(next(stream).settings_revision[-1])

    def begin_typing(self, text):
        """Types into the isovalue's field, key by key; the settings' revision before."""
        before = self.settings_revision()
        self.window.do("mousemove", *ISOVALUE, "keydown", "ctrl", "click", 1, "keyup", "ctrl")
        for key in text:
            self.window.do("key", "period" if key == "." else key)
            self.window.picture("F12")
            self.assertEqual(self.settings_revision(), before, text)
        return before

    def test_a_typed_isovalue_is_one_change_when_the_field_is_done(self):
        for text, end in (("0.299", ("key", "Return")),
                          ("0.41", ("mousemove", 20, 700, "click", 1))):
            before = self.begin_typing(text)
            self.window.do(*end)
            self.assertTrue(wait_until(
                lambda at=float(text): abs(self.conn.settings.isovalue - at) < 1e-6))
            self.window.picture("F12")
            self.assertEqual(self.settings_revision(), before + 1)

    def test_escape_in_a_field_restores_the_field_alone(self):
        isovalue = self.conn.settings.isovalue
        before = self.begin_typing("0.77")
        self.window.do("key", "Escape")
        for _ in range(3):
            self.window.picture("F12")
        self.assertEqual(self.settings_revision(), before)
        self.assertEqual(self.conn.settings.isovalue, isovalue)
        self.assertEqual(self.conn.device.info().forces.state, palpate.ForceState.ON)

    def test_without_the_brush_a_drag_turns_the_view_and_edits_nothing(self):
        before = np.asarray(self.window.picture("s"))
        self.assertTrue(np.array_equal(before, np.asarray(self.window.picture("s"))))
        first = self.revision()
        x, y = VIEW
        self.window.drag([(x + step, y) for step in range(-40, 41, 5)])
        self.assertTrue(wait_until(
            lambda: not np.array_equal(before, np.asarray(self.window.picture("s")))))
        self.assertEqual(self.revision(), first)
        # Nor does the way to a click move it.
        turned = np.asarray(self.window.picture("s"))
        self.window.do("mousemove", 20, 700, "mousemove", *VIEW, "click", 3)
        self.window.do("mousemove", 20, 700, "mousemove", *VIEW, "click", 1)
        self.assertTrue(np.array_equal(turned, np.asarray(self.window.picture("s"))))
        self.window.do("key", "r")
        self.assertTrue(wait_until(
            lambda: np.array_equal(before, np.asarray(self.window.picture("s")))))

    def test_pictures_of_window_and_view(self):
        self.assertEqual(self.window.picture("F12").size, (1280, 800))
        width, height = self.window.picture("s").size
        self.assertEqual(width, 680)
        self.assertLess(height, 760)
        # Both at once.
        before = set(self.window.folder.glob("palpate-*.png"))
        self.window.do("key", "s", "key", "F12")
        self.assertTrue(wait_until(
            lambda: len(set(self.window.folder.glob("palpate-*.png")) - before) == 2))


class ViewWindowAtItsLimits(unittest.TestCase):
    def open(self, *arguments, socket="palpated.sock"):
        folder = self.enterContext(Daemon()).folder
        window = Window(self.enterContext(Screen()), folder, "--socket", folder / socket,
                        *arguments)
        self.addCleanup(window.end)
        return window

    def test_a_small_window_has_room_for_all_that_matters(self):
        window = self.open("--size", "200x150")
        window.wait_for_title("Palpate: builtin:sphere:48")
        picture = window.picture()
        self.assertEqual(picture.size, (640, 400))
        # The connection's green dot, and the red of the emergency stop.
        left = np.asarray(picture)[8:32, 8:30].reshape(-1, 3).astype(int)
        self.assertTrue(((left[:, 1] > 180) & (left[:, 0] < 120)).any())
        right = np.asarray(picture)[8:32, 470:].reshape(-1, 3).astype(int)
        self.assertGreater(int(((right[:, 0] > 150) & (right[:, 1] < 60)).sum()), 1000)

    def test_without_a_display_it_says_what_to_do(self):
        code, _, said = run_view(env=WITHOUT_DISPLAY)
        self.assertEqual(code, 8)
        self.assertIn("--offscreen", said)

    def test_it_ends_in_order_without_a_daemon(self):
        window = self.open(socket="nobody.sock")
        window.wait_for_title("Palpate: reconnecting")
        self.assertEqual(window.end(), (0, ""))
