"""palpate-view in a window: the brush, the handles of what cuts, and filters."""

import time
import unittest

import numpy as np
from support import DaemonTest, wait_until
from view_support import LEFT, Screen, Window

# The pointer is beside the surface there.
BESIDE = (-310, 150)
STROKE_PX = 120
STROKE_S = 2.0


class ViewEdit(DaemonTest):
    """One daemon and one window. Each test leaves volume and view as they were."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # Without the stylus a view that nobody turns stays the same.
        cls.window = Window(cls.enterClassContext(Screen()), cls.daemon.folder, "--socket",
                            cls.daemon.socket, "--no-overlay")
        cls.addClassCleanup(cls.window.end)
        cls.window.wait_for_title("Palpate: builtin:sphere:48")
        view = cls.window.picture("s")
        cls.middle = cls.place_of(np.asarray(view), np.asarray(cls.window.picture()))

    @staticmethod
    def place_of(view, window):
        """Where the middle of the view is in the window: found by its picture's middle rows."""
        height, width = view.shape[:2]
        part = view[height // 2 - 20:height // 2 + 20, width // 2 - 20:width // 2 + 20].astype(int)
        best = None
        for y in range(0, window.shape[0] - 40):
            for x in (window.shape[1] // 2 - 20 + step for step in range(-120, 121)):
                away = np.abs(window[y, x:x + 40] - part[0]).sum()
                if away > 40:
                    continue
                away = np.abs(window[y:y + 40, x:x + 40].astype(int) - part).sum()
                if best is None or away < best[0]:
                    best = (away, x + 20, y + 20)
        return best[1:]

    def at(self, right, down):
        """A place of the window, from the view's middle."""
        return self.middle[0] + right, self.middle[1] + down

    def view(self):
        return np.asarray(self.window.picture("s")).astype(int)

    def settled(self):
        """The view at rest, of all bricks."""
        seen = [self.view()]

        def still():
            seen.append(self.view())
            return np.array_equal(*seen[-2:])

        self.assertTrue(wait_until(still))
        return seen[-1]

    def values(self):
        return self.conn.volume.download().values

    def revision(self):
        return self.conn.volume.info().volume_revision

    def at_rest(self):
        """The voxels after the last edit that is still on its way."""
        seen = [None, self.values()]

        def same():
            time.sleep(2.0)
            seen.append(self.values())
            return np.array_equal(*seen[-2:])

        self.assertTrue(wait_until(same))
        return seen[-1]

    def undo_to(self, values):
        self.window.do("key", "ctrl+z")
        self.assertTrue(wait_until(lambda: np.array_equal(self.values(), values)))


class Brush(ViewEdit):
    def test_its_ball_is_at_the_pointer_and_grows(self):
        self.window.do("mousemove", *self.at(*BESIDE))
        without = self.settled()
        height, width = without.shape[:2]
        self.window.do("key", "b")
        self.addCleanup(self.window.do, "key", "b")

        def ball():
            """Box of the pixels that the ball changes: left, top, right, bottom."""
            rows, columns = np.nonzero(np.abs(self.settled() - without).sum(axis=2) > 30)
            if not rows.size:
                return None
            return np.array([columns.min(), rows.min(), columns.max(), rows.max()])

        # Nothing beside the surface.
        self.assertIsNone(ball())
        for right, down in ((0, 0), (40, 25)):
            self.window.do("mousemove", *self.at(right, down))
            box = ball()
            middle = (box[:2] + box[2:]) / 2
            np.testing.assert_allclose(middle, (width // 2 + right, height // 2 + down), atol=4)
        first = box[2] - box[0]
        # As a person types them.
        for way in (("key", "bracketright", "key", "bracketright", "key", "bracketright"),
                    ("keydown", "ctrl", "click", 4, "click", 4, "click", 4, "keyup", "ctrl")):
            self.window.do(*way)
            self.assertTrue(wait_until(lambda least=first: (
                box := ball()) is not None and box[2] - box[0] > 1.15 * least), way)
            first = ball()[2] - ball()[0]
        for _ in range(6):
            self.window.do("key", "bracketleft")
        self.window.do("mousemove", *self.at(*BESIDE))
        self.assertTrue(wait_until(lambda: np.array_equal(self.view(), without)))

    def stroke(self, samples_per_s):
        """A straight drag over the middle; the voxels after it."""
        samples = int(STROKE_S * samples_per_s)
        start = -STROKE_PX // 2
        # The window shows the surface as it is: the stroke follows what is seen.
        self.window.do("mousemove", *self.at(*BESIDE))
        self.settled()
        self.window.do("mousemove", *self.at(start, 0), "mousedown", 1)
        # Seen by the window before the pointer goes on.
        self.window.picture()
        for n in range(1, samples + 1):
            begun = time.monotonic()
            self.window.do("mousemove", *self.at(start + round(STROKE_PX * n / samples), 0))
            time.sleep(max(0.0, begun + 1 / samples_per_s - time.monotonic()))
        self.window.do("mouseup", 1)
        return self.at_rest()

    def test_a_stroke_is_as_deep_however_often_the_pointer_is_sampled(self):
        loaded = self.values()
        isovalue = self.conn.settings.isovalue
        self.window.do("key", "b")
        self.addCleanup(self.window.do, "key", "b")
        strokes = {}
        for samples_per_s in (2, 5, 60):
            strokes[samples_per_s] = self.stroke(samples_per_s)
            self.undo_to(loaded)
        removed = {rate: (values < isovalue) != (loaded < isovalue)
                   for rate, values in strokes.items()}
        self.assertGreater(removed[60].sum(), 100)
        for rate in (2, 5):
            # Every voxel that one removes and the other does not would be half a voxel or more.
            self.assertEqual((removed[rate] != removed[60]).sum(), 0, rate)


class Cutting(ViewEdit):
    def handles(self):
        """Pixels of handles that nobody holds, (x, y) from the view's middle."""
        view = self.view()
        red, green, blue = np.moveaxis(view, 2, 0)
        rows, columns = np.nonzero((red > 120) & (blue < 0.45 * red) & (green > 0.5 * red)
                                   & (green < 0.715 * red))
        return np.stack([columns - view.shape[1] // 2, rows - view.shape[0] // 2], axis=1)

    def open_panel(self):
        self.window.tab("Cut")
        self.assertTrue(wait_until(lambda: self.handles().size))

    def test_a_handle_moves_its_face_and_does_not_turn_the_view(self):
        self.open_panel()
        self.window.do("mousemove", *self.at(*BESIDE))
        whole = self.settled()
        first = self.revision()
        for tool in ("none", "brush"):
            if tool == "brush":
                self.window.do("key", "b")
            places = self.handles()
            # The head of the arrow that is farthest right; somewhat inside of it.
            tip = places[places[:, 0].argmax()] - (4, 0)
            self.window.drag([self.at(*(tip - (step, 0))) for step in range(0, 91, 15)])
            self.window.do("mousemove", *self.at(*BESIDE))
            cut = self.settled()
            self.assertFalse(np.array_equal(cut, whole), tool)
            # It went with the pointer.
            moved = self.handles()
            self.assertTrue((np.abs(moved - (tip - (90, 0))).sum(axis=1) < 40).any(), tool)
            self.window.press("Whole volume")
            self.window.do("mousemove", *self.at(*BESIDE))
            self.assertTrue(wait_until(lambda: np.array_equal(self.view(), whole)), tool)
        self.assertEqual(self.revision(), first)
        self.window.do("key", "b")
        # A plane, too: by its arrow.
        self.window.press("Plane 1")
        self.window.do("mousemove", *self.at(*BESIDE))
        half = self.settled()
        self.assertFalse(np.array_equal(half, whole))
        self.window.press("Plane 1")
        self.window.do("mousemove", *self.at(*BESIDE))
        self.assertTrue(wait_until(lambda: np.array_equal(self.view(), whole)))


class Filtering(ViewEdit):
    def test_a_filter_replaces_the_region_as_one_step(self):
        before = self.values()
        first = self.revision()
        self.window.tab("Edit")
        self.window.press("Apply the filter")
        self.assertTrue(wait_until(lambda: self.revision() == first + 1))
        everywhere = self.values() != before
        self.assertTrue(everywhere.any())
        self.undo_to(before)
        # Around the proxy alone.
        self.window.press("whole volume")
        self.window.press("ball at the proxy")
        self.window.press("Apply the filter")
        self.assertTrue(wait_until(lambda: self.revision() == first + 3))
        near = self.values() != before
        self.assertTrue(near.any())
        self.assertLess(near.sum(), 0.7 * everywhere.sum())
        self.assertFalse((near & ~everywhere).any())
        self.undo_to(before)

    def test_the_kind_is_chosen_with_the_pointer(self):
        before = self.values()
        first = self.revision()
        self.window.tab("Edit")
        # The button that undoes a filter has its name, too.
        _, y = self.window.find("Kind", within=LEFT)
        self.window.press("gaussian", within=(0, y - 12, 300, y + 12))
        self.window.press("median", within=LEFT)
        self.window.press("Apply the filter")
        self.assertTrue(wait_until(lambda: self.revision() == first + 1))
        median = self.values()
        self.assertFalse(np.array_equal(median, before))
        # Other filters would make values that were not there.
        self.assertTrue(np.isin(median, before).all())
        self.undo_to(before)


if __name__ == "__main__":
    unittest.main()
