"""palpate-view in a window: what pointer, keys and panels do, seen by another client and in its
pictures."""

import os
import signal
import unittest

import numpy as np
import palpate
from support import Daemon, DaemonTest, nrrd, pattern, wait_until
from text_in_picture import places_of
from view_support import (LEFT, RIGHT, SLICE_WIDTH, SLICES, STATE, VIEW, VIEW_AREA, WITHOUT_DISPLAY,
                          Screen, Window, run_view)

# The first slice. The series bar takes its height from the view.
SLICE = (SLICES[0], SLICES[1], SLICES[0] + SLICE_WIDTH, SLICES[3])
SERIES = (VIEW_AREA[0], VIEW_AREA[3] - 44, VIEW_AREA[0] + 100, VIEW_AREA[3])
HISTOGRAM_X = (10, 290)
POSITION_X = (372, 490, 900)  # before, within and beyond the series' slider


def histogram_x(share):
    return round(HISTOGRAM_X[0] + share * (HISTOGRAM_X[1] - HISTOGRAM_X[0]))


def mark_x(picture, y):
    """Middle of the isovalue's mark, a yellow line over the histogram."""
    row = np.asarray(picture)[y, HISTOGRAM_X[0]:HISTOGRAM_X[1]].astype(int)
    yellow = np.flatnonzero((row[:, 0] > 240) & (row[:, 1] > 220) & (row[:, 2] < 160))
    return HISTOGRAM_X[0] + float(yellow.mean()) if yellow.size else None


class OneWindow(DaemonTest):
    """One daemon and one window for all tests of a class."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # Without the stylus a view that nobody turns stays the same.
        cls.window = Window(cls.enterClassContext(Screen()), cls.daemon.folder, "--socket",
                            cls.daemon.socket, "--no-overlay")
        cls.addClassCleanup(cls.window.end)
        cls.window.wait_for_title("Palpate: builtin:sphere:48")
        # The line below the histogram.
        cls.isovalue_y = cls.window.find("of range", within=LEFT)[1]
        cls.histogram_y = cls.isovalue_y - 50

    def revision(self):
        return self.conn.volume.info().volume_revision

    def view(self):
        return np.asarray(self.window.picture("s"))

    def slice(self):
        left, top, right, bottom = SLICE
        return np.asarray(self.window.picture())[top:bottom, left:right].astype(int)

    def becomes(self, picture):
        """Whether the view is soon the same as that."""
        return wait_until(lambda: np.array_equal(self.view(), picture))

    def changes_from(self, picture):
        return wait_until(lambda: not np.array_equal(self.view(), picture))

    def settled(self, look):
        """What it shows at rest, of all bricks."""
        seen = [look()]

        def still():
            seen.append(look())
            return np.array_equal(*seen[-2:])

        self.assertTrue(wait_until(still))
        return seen[-1]


class ViewWindow(OneWindow):
    def test_a_dragged_isovalue_is_felt_by_others_while_it_is_dragged(self):
        info = self.conn.volume.info()

        def share():
            extent = info.value_max - info.value_min
            return (self.conn.settings.isovalue - info.value_min) / extent

        self.window.do("mousemove", histogram_x(0.5), self.histogram_y, "mousedown", 1)
        for wanted in (0.3, 0.7, 0.55):
            self.window.do("mousemove", histogram_x(wanted), self.histogram_y)
            self.assertTrue(wait_until(lambda at=wanted: abs(share() - at) < 0.01),
                            f"{share()} is not {wanted}")
        self.window.do("mouseup", 1)

    def test_the_slider_follows_other_clients(self):
        info = self.conn.volume.info()
        for share in (0.35, 0.6):
            self.conn.settings.isovalue = info.value_min + share * (info.value_max - info.value_min)
            self.assertTrue(wait_until(
                lambda at=share: abs((mark_x(self.window.picture(), self.histogram_y) or 0)
                               - histogram_x(at)) <= 2))

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
        self.window.do("mousemove", 60, self.isovalue_y, "keydown", "ctrl", "click", 1, "keyup", "ctrl")
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
        # Other tests have changed the surface, and the first view shows the surface of now.
        self.window.do("key", "r")
        before = self.settled(self.view)
        first = self.revision()
        x, y = VIEW
        self.window.drag([(x + step, y) for step in range(-40, 41, 5)])
        self.assertTrue(self.changes_from(before))
        self.assertEqual(self.revision(), first)
        # Nor does the way to a click move it.
        turned = self.view()
        self.window.do("mousemove", 20, 700, "mousemove", *VIEW, "click", 3)
        self.window.do("mousemove", 20, 700, "mousemove", *VIEW, "click", 1)
        self.assertTrue(np.array_equal(turned, self.view()))
        self.window.do("key", "r")
        self.assertTrue(self.becomes(before))

    def test_pictures_of_window_and_view(self):
        self.assertEqual(self.window.picture("F12").size, (1280, 800))
        width, height = self.window.picture("s").size
        self.assertEqual(width, 668)
        self.assertLess(height, 760)
        # Both at once.
        before = set(self.window.folder.glob("palpate-*.png"))
        self.window.do("key", "s", "key", "F12")
        self.assertTrue(wait_until(
            lambda: len(set(self.window.folder.glob("palpate-*.png")) - before) == 2))


def centre_of_button(picture, left, top, right, bottom):
    """Of the uppermost button that is there, by its colour."""
    part = np.asarray(picture)[top:bottom, left:right].astype(int)
    blue = np.abs(part - (43, 79, 121)).max(axis=2) <= 4
    rows = np.flatnonzero(blue.sum(axis=1) > 40)
    if not rows.size:
        return None
    columns = np.flatnonzero(blue[rows[0]])
    return left + int(columns.mean()), top + int(rows[0]) + 8


class ViewPanels(OneWindow):
    """Each leaves volume, cross-hair and cuts as they were."""

    def test_crop_and_the_whole_volume_again(self):
        self.window.tab("Cut")
        whole = self.settled(self.view)
        seen = []
        # The lower ends of x, y and z: the left half of the slider.
        for axis in range(3):
            self.window.do("mousemove", 1, 1)
            # The most alike: the others begin as it does.
            y = LEFT[1] + places_of("Crop " + "xyz"[axis], self.window.picture().crop(LEFT))[0][1]
            self.window.drag([(50 + step, y) for step in range(0, 141, 20)])
            self.assertTrue(self.changes_from(whole), axis)
            seen.append(self.settled(self.view))
            self.window.press("Whole volume", within=LEFT)
            self.assertTrue(self.becomes(whole), axis)
        # Each axis cuts something else.
        self.assertFalse(np.array_equal(seen[0], seen[1]) or np.array_equal(seen[1], seen[2]))

    def drag_offset(self, to_x):
        """The view afterwards, with another tab: without the handles."""
        self.window.tab("Cut")
        _, offset = self.window.find("Offset", within=LEFT)
        if to_x is not None:
            self.window.drag([(90, offset), (to_x, offset)])
        self.window.tab("Surface")
        return self.settled(self.view)

    def test_a_clip_plane_and_its_ends(self):
        self.window.tab("Surface")
        whole = self.settled(self.view)
        self.window.tab("Cut")
        _, plane = self.window.find("Plane 1", within=LEFT)
        self.window.click(20, plane)
        half = self.drag_offset(None)
        self.assertFalse(np.array_equal(half, whole))
        # At one end it cuts nothing, at the other everything.
        self.assertTrue(np.array_equal(self.drag_offset(290), whole))
        nothing = self.drag_offset(0)
        self.assertFalse(np.array_equal(nothing, half) or np.array_equal(nothing, whole))
        self.window.tab("Cut")
        self.window.click(20, plane)
        self.window.tab("Surface")
        self.assertTrue(self.becomes(whole))

    def test_a_click_moves_the_cross_hair_and_ends_following(self):
        left, top, _, _ = SLICE
        places = [(left + 70, top + 90), (left + 150, top + 140)]
        pictures = []
        self.window.do("key", "c")
        for place in places:
            self.window.click(*place)
            # Where the pointer is, the window shows the value.
            self.window.do("mousemove", 640, 20)
            pictures.append(self.settled(self.slice))
        # The stylus moves, but the cross-hair does not; nothing but its lines has changed.
        rows, columns = np.nonzero(np.abs(pictures[0] - pictures[1]).sum(axis=2))
        self.assertGreater(rows.size, 200)
        near = [(np.abs(columns + left - x) <= 1) | (np.abs(rows + top - y) <= 1)
                for x, y in places]
        self.assertTrue((near[0] | near[1]).all())
        self.assertTrue(near[0].any() and near[1].any())
        # It follows again.
        self.window.do("key", "c")
        self.assertTrue(wait_until(lambda: not np.array_equal(self.slice(), pictures[1])))

    def test_stiffness_is_felt_by_others_while_it_is_dragged(self):
        _, y = self.window.find("Stiffness", within=RIGHT)
        self.window.do("mousemove", 1080, y, "mousedown", 1)
        # The slider's grab, 12 pixels wide, goes from x = 992 to 1128, for 0 to 3 N/mm.
        for x in (1010, 1100, 1060):
            self.window.do("mousemove", x, y)
            wanted = 3.0 * (x - 998) / 124
            self.assertTrue(wait_until(
                lambda at=wanted: abs(self.conn.settings.stiffness_n_per_mm - at) < 0.15), x)
        self.window.do("mousemove", 900, y)
        self.assertTrue(wait_until(lambda: self.conn.settings.stiffness_n_per_mm == 0.0))
        self.window.do("mouseup", 1)

    def test_forces_are_enabled_after_the_emergency_stop(self):
        self.conn.device.enable()
        self.assertTrue(wait_until(self.forces_are(palpate.ForceState.ON)))
        self.window.do("key", "Escape")
        self.assertTrue(wait_until(self.forces_are(palpate.ForceState.STOPPED)))
        self.assertTrue(wait_until(lambda: self.bar_is((140, 26, 24)) and self.bar_button()))
        self.window.click(*self.bar_button())
        self.assertTrue(wait_until(self.forces_are(palpate.ForceState.ON)))
        self.assertTrue(wait_until(lambda: self.bar_is((22, 92, 48))))
        # Of a daemon that hangs it claims nothing, long before it counts as lost.
        os.kill(self.daemon.process.pid, signal.SIGSTOP)
        try:
            self.assertTrue(wait_until(lambda: not self.bar_is((22, 92, 48)) and self.dot_is_red()))
            self.assertEqual(self.window.title(), "Palpate: builtin:sphere:48")
        finally:
            os.kill(self.daemon.process.pid, signal.SIGCONT)
        self.assertTrue(wait_until(
            lambda: self.bar_is((22, 92, 48)) and not self.dot_is_red()))

    def dot_is_red(self):
        dot = np.asarray(self.window.picture())[8:32, 8:110].reshape(-1, 3).astype(int)
        return bool(((dot[:, 0] > 200) & (dot[:, 1] < 150)).any())

    def forces_are(self, state):
        return lambda: self.conn.device.info().forces.state == state

    def bar_is(self, color):
        left, top, right, bottom = STATE
        part = np.asarray(self.window.picture())[top:bottom, left:right].astype(int)
        return (np.abs(part - color).max(axis=2) < 4).mean() > 0.5

    def bar_button(self):
        return centre_of_button(self.window.picture(), *STATE)


class SeriesBar(OneWindow):
    def test_play_pause_and_position(self):
        for n in range(4):
            path = self.daemon.folder / f"frame{n}.nrrd"
            path.write_bytes(nrrd(pattern((12, 10, 9)) + 1000.0 * n))
        self.conn.series.load(self.daemon.folder / "frame*.nrrd")
        self.conn.series.configure(loop=True)

        def bar_is_there():
            return centre_of_button(self.window.picture(), *SERIES)

        self.assertTrue(wait_until(bar_is_there))
        play_x, series_y = bar_is_there()
        before, within, beyond = POSITION_X
        for end, position in ((beyond, 3.0), (before, 0.0), (beyond, 3.0)):
            self.window.drag([(within, series_y), (end, series_y)])
            self.assertTrue(wait_until(
                lambda at=position: self.conn.series.state().position_frames == at))
        # Each press is of what the button says: the answer to the one before came.
        for playing in (True, False, True, False):
            self.window.click(play_x, series_y)
            self.assertTrue(wait_until(
                lambda wanted=playing: self.conn.series.state().playing == wanted), playing)
            self.assertTrue(wait_until(lambda wanted=playing: self.bar_says(wanted)))

    def bar_says(self, playing):
        """Whether the button's text is as wide as that of Pause, or of Play."""
        part = np.asarray(self.window.picture())[SERIES[1] + 6:SERIES[3] - 8,
                                                  SERIES[0] + 10:SERIES[0] + 68].astype(int)
        columns = np.flatnonzero((part.min(axis=2) > 200).any(axis=0))
        return columns.size and (columns[-1] - columns[0] > 32) == playing


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
        left = np.asarray(picture)[8:32, 8:110].reshape(-1, 3).astype(int)
        self.assertTrue(((left[:, 1] > 180) & (left[:, 0] < 120)).any())
        right = np.asarray(picture)[8:32, 470:].reshape(-1, 3).astype(int)
        self.assertGreater(int(((right[:, 0] > 150) & (right[:, 1] < 60)).sum()), 1000)

    def test_without_a_display_it_says_what_to_do(self):
        code, _, said = run_view(env=WITHOUT_DISPLAY)
        self.assertEqual(code, 8)
        self.assertIn("--offscreen", said)

    def test_it_ends_in_order_without_a_daemon(self):
        window = self.open(socket="nobody.sock")
        window.wait_for_title("Palpate: not connected")
        self.assertEqual(window.end(), (0, ""))
