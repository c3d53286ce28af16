"""Anatomy, measuring and slices in the window: sides, values, lengths, greys.

The panes of the slices are found by their captions; what a pane shows at a pixel is computed here
as drawing/slice_view.h says it.
"""

import numpy as np
from support import DaemonTest, nrrd, wait_until
from text_in_picture import likeness_of, places_of
from view_support import LEFT, Screen, Window

# Tall slices: there is empty ground at their left and right.
SIZE = np.array((10, 8, 30))
SPACING_MM = np.array((2.0, 2.5, 3.0))
ORIGIN_MM = np.array((-31.0, 12.03, 205.0))  # so that no middle is halfway between two tenths
GROUND = (15, 17, 21)  # of a slice beside the lattice
CUBE_FACE = (135, 139, 148)  # of the cube, seen straight ahead


def volume():
    """A ramp along each axis, so that each voxel has its own value."""
    x, y, z = np.indices(SIZE)
    return 100.0 * x + 7.0 * y + 1000.0 * z


class Pane:
    """A coronal or sagittal slice on the screen."""

    def __init__(self, window, caption, right_axis, zoom=1.0):
        x, y = window.find(caption)
        picture = np.asarray(window.picture())
        is_ground = (np.abs(picture.astype(int) - GROUND).max(axis=2) <= 1)
        row = y + 60
        self.left = x
        while is_ground[row, self.left - 1] or is_ground[row + 40, self.left - 1]:
            self.left -= 1
        column = self.left + 2
        self.top, self.bottom = row, row
        while is_ground[self.top - 1, column] or is_ground[self.top - 1, column + 1]:
            self.top -= 1
        # The lines of the cross-hair are one pixel wide.
        while is_ground[self.bottom:self.bottom + 2, column].any():
            self.bottom += 1
        self.right = self.left + 10
        while not (np.abs(picture[row, self.right].astype(int) - (28, 31, 36)).max() <= 1):
            self.right += 1
        self.axes = np.array((right_axis, 2))
        extent = np.array((self.right - self.left, self.bottom - self.top))
        self.px_per_mm = zoom * (extent / ((SIZE[self.axes] + 1) * SPACING_MM[self.axes])).min()
        self.middle = np.array((self.left, self.top)) + extent / 2

    def place_mm(self, x, y):
        """Along the right axis and along z."""
        across, down = (np.array((x, y)) - self.middle) / self.px_per_mm
        middle = ORIGIN_MM[self.axes] + (SIZE[self.axes] - 1) / 2 * SPACING_MM[self.axes]
        return middle[0] + across, middle[1] - down

    def pixel_of(self, voxel):
        """Of a voxel along the right axis and along z; whole pixels near it."""
        middle = (SIZE[self.axes] - 1) / 2
        away = (np.array(voxel) - middle) * SPACING_MM[self.axes] * self.px_per_mm
        return tuple(int(round(n)) for n in self.middle + away * (1, -1))


class OfPatient(DaemonTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        daemon = cls.daemon
        path = daemon.folder / "ramp.nrrd"
        path.write_bytes(nrrd(volume(), np.diag(SPACING_MM).tolist(), ORIGIN_MM.tolist()))
        cls.conn.volume.load(path)
        cls.window = Window(cls.enterClassContext(Screen()), daemon.folder, "--socket",
                            daemon.socket, "--no-overlay", "--no-letters", "--color", "0,255,0")
        cls.addClassCleanup(cls.window.end)
        cls.window.wait_for_title("Palpate: ramp.nrrd")
        cls.coronal = Pane(cls.window, "coronal", 0)
        cls.sagittal = Pane(cls.window, "sagittal", 1)

    def setUp(self):
        # The cross-hair in the middle of the volume.
        for pane in (self.sagittal, self.coronal):
            self.window.click(*(int(n) for n in pane.middle))

    def picture_of(self, pane):
        return self.window.picture().crop((pane.left, pane.top, pane.right, pane.bottom))

    def best(self, texts):
        """The one of some texts that the coronal slice shows, by its pixels."""
        picture = self.picture_of(self.coronal)
        return max(texts, key=lambda text: likeness_of(text, picture))

    def shows(self, text, pane=None):
        return bool(places_of(text, self.picture_of(pane or self.coronal)))

    def test_value_and_place_under_the_pointer(self):
        for voxel in ((2, 5), (7, 21), (4, 14)):
            x, y = self.coronal.pixel_of(voxel)
            self.window.do("mousemove", x, y)
            left, superior = self.coronal.place_mm(x, y)
            posterior = ORIGIN_MM[1] + (SIZE[1] - 1) / 2 * SPACING_MM[1]
            place = "{} {:.1f} P {:.1f} S {:.1f} mm".format
            expected = place("L" if left >= 0 else "R", abs(left), posterior, superior)
            others = [place("L" if at >= 0 else "R", abs(at), posterior, superior + step)
                      for step in (-1.0, -0.5, 0, 0.5, 1.0) for at in (left - 1, left, left + 1)]
            self.assertTrue(wait_until(lambda: self.shows(expected)), expected)
            self.assertEqual(self.best(others), expected)
            index = (np.array((left, posterior, superior)) - ORIGIN_MM) / SPACING_MM
            value = index @ (100.0, 7.0, 1000.0)
            texts = [f"{value + step:.5g}" for step in (-3000, -1000, -300, 0, 300, 1000, 3000)]
            self.assertEqual(self.best(texts), texts[3])

    def length_of(self, between):
        """The text of a length, which is one of these numbers."""
        return self.best([f"{mm:.1f} mm" for mm in between])

    def test_two_clicks_in_a_slice_are_a_distance_until_it_is_removed(self):
        a, b = self.coronal.pixel_of((1, 3)), self.coronal.pixel_of((8, 25))
        mm = np.hypot(a[0] - b[0], a[1] - b[1]) / self.coronal.px_per_mm
        self.window.do("key", "m")
        self.window.click(*a)
        self.window.click(*b)
        self.window.do("mousemove", 20, 780)
        text = f"{mm:.1f} mm"
        self.assertTrue(wait_until(lambda: self.shows(text)), text)
        self.assertEqual(self.length_of(mm + step for step in (-3, -2, -1, 0, 1, 2, 3)), text)
        # A right click beside the line leaves it, one on the line removes it.
        self.window.do("mousemove", a[0] + 30, a[1], "click", 3)
        self.assertTrue(self.shows(text))
        self.window.do("mousemove", (a[0] + b[0]) // 2, (a[1] + b[1]) // 2, "click", 3)
        self.window.do("mousemove", 20, 780)
        self.assertTrue(wait_until(lambda: not self.shows(text)))
        # The key takes away the last one.
        self.window.click(*a)
        self.window.click(*b)
        self.window.do("mousemove", 20, 780)
        self.assertTrue(wait_until(lambda: self.shows(text)))
        self.window.do("key", "Delete")
        self.assertTrue(wait_until(lambda: not self.shows(text)))
        self.window.do("key", "m")

    def test_a_saved_view_is_removed_while_there_are_distances(self):
        self.window.tab("Look")
        for heading in ("Distances", "Saved views"):
            self.window.press(heading, within=LEFT)
        self.window.do("key", "m")
        a, b = self.coronal.pixel_of((1, 3)), self.coronal.pixel_of((8, 25))
        self.window.click(*a)
        self.window.click(*b)
        distance = f"1: {np.hypot(a[0] - b[0], a[1] - b[1]) / self.coronal.px_per_mm:.1f} mm"
        self.window.press("Save the view", within=LEFT)
        _, y = self.window.find("View 1", within=LEFT)
        self.window.press("Remove", within=(0, y - 12, 306, y + 12))
        self.assertTrue(wait_until(lambda: not self.window.shows("View 1", within=LEFT)))
        # The distance is still there, and goes by its own button.
        _, y = self.window.find(distance, within=LEFT)
        self.window.press("Remove", within=(0, y - 12, 306, y + 12))
        self.assertTrue(wait_until(lambda: not self.window.shows(distance, within=LEFT)))
        self.window.do("key", "m")

    def grays(self, pane):
        part = np.asarray(self.window.picture()).astype(int)
        middle_x, middle_y = (int(n) for n in pane.middle)
        return part[middle_y - 60:middle_y + 60, middle_x - 10:middle_x + 10]

    def drag_right_button(self, by):
        x, y = (int(n) for n in self.coronal.middle)
        self.window.do("mousemove", x, y, "mousedown", 3)
        self.window.do("mousemove", x + by[0] // 2, y + by[1] // 2)
        self.window.do("mousemove", x + by[0], y + by[1], "mouseup", 3)
        self.window.do("mousemove", 20, 780)

    def test_the_right_button_changes_level_and_width(self):
        before = self.grays(self.coronal)
        # Narrower: more contrast.
        self.drag_right_button((-40, 0))
        self.assertTrue(wait_until(lambda: self.grays(self.coronal).std() > 1.2 * before.std()))
        # A higher level: darker.
        brightness = self.grays(self.coronal).mean()
        self.drag_right_button((0, -20))
        self.assertTrue(wait_until(lambda: self.grays(self.coronal).mean() < brightness - 20))

    def pane_picture(self):
        pane = self.coronal
        return np.asarray(self.window.picture())[pane.top + 60:pane.bottom, pane.left:pane.right]

    def test_slices_stay_until_they_are_told_to_follow(self):
        self.window.do("mousemove", 20, 780)
        before = self.pane_picture()
        with self.conn.poses() as stream:
            first = next(stream).hip_mm[-1]
            self.assertTrue(wait_until(
                lambda: np.linalg.norm(next(stream).hip_mm[-1] - first) > 2.0))
        np.testing.assert_array_equal(self.pane_picture(), before)
        self.window.press("Follow the stylus (C)")
        self.assertTrue(wait_until(lambda: not np.array_equal(self.pane_picture(), before)))
        # A click on a slice ends it.
        self.window.click(*self.coronal.pixel_of((5, 15)))
        self.window.do("mousemove", 20, 780)
        still = self.pane_picture()
        with self.conn.poses() as stream:
            first = next(stream).hip_mm[-1]
            self.assertTrue(wait_until(
                lambda: np.linalg.norm(next(stream).hip_mm[-1] - first) > 2.0))
        np.testing.assert_array_equal(self.pane_picture(), still)

    def wheel(self, button, times, *keys):
        for key in keys:
            self.window.do("keydown", key)
        self.window.do("click", "--repeat", times, button)
        for key in keys:
            self.window.do("keyup", key)

    def shown_at(self, point, expected, pane=None):
        """Whether the place that the slice shows under the pointer is that."""
        self.window.do("mousemove", *point)
        return wait_until(lambda: self.shows(expected, pane))

    def test_zoom_and_drag_keep_the_point_under_the_pointer(self):
        x, y = self.coronal.pixel_of((6, 9))
        self.window.do("mousemove", x, y)
        before = self.pane_picture()
        left, superior = self.coronal.place_mm(x, y)
        place = f"{'L' if left >= 0 else 'R'} {abs(left):.1f} P 20.8 S {superior:.1f} mm"
        self.assertTrue(wait_until(lambda: self.shows(place)), place)
        self.wheel(4, 3, "ctrl")
        self.assertTrue(wait_until(lambda: not np.array_equal(self.pane_picture(), before)))
        self.assertTrue(self.shown_at((x, y), place))
        # The dragged point goes along.
        self.window.do("mousemove", x, y, "mousedown", 2)
        self.window.do("mousemove", x - 15, y - 10)
        self.window.do("mousemove", x - 20, y - 15, "mouseup", 2)
        self.assertTrue(self.shown_at((x - 20, y - 15), place))
        self.wheel(5, 4, "ctrl")
        self.window.do("mousemove", x, y)
        self.assertTrue(self.shown_at((x, y), place))
        # Without ctrl: the next slice, half a voxel from the middle one.
        self.wheel(4, 1)
        posterior = f"{ORIGIN_MM[1] + 5 * SPACING_MM[1]:.1f} mm"
        self.assertTrue(wait_until(lambda: self.shows(posterior)), posterior)

    def test_a_double_click_makes_a_slice_as_large_as_the_view(self):
        small = self.window.find("coronal")
        height = self.coronal.bottom - self.coronal.top
        point = self.coronal.pixel_of((5, 4))
        self.window.do("mousemove", *point, "click", "--repeat", 2, "--delay", 60, 1)
        self.assertTrue(wait_until(lambda: self.window.find("coronal")[1] < small[1] - 100))
        large = Pane(self.window, "coronal", 0)
        self.assertGreater(large.bottom - large.top, 1.5 * height)
        # It shows what it showed; the view is in its place.
        left, superior = large.place_mm(*large.pixel_of((6, 9)))
        place = f"{'L' if left >= 0 else 'R'} {abs(left):.1f} P"
        self.assertTrue(self.shown_at(large.pixel_of((6, 9)), place, large), place)
        self.window.do("mousemove", *large.pixel_of((5, 4)), "click", "--repeat", 2, "--delay", 60,
                       1)
        self.assertTrue(wait_until(lambda: self.window.find("coronal")[1] > small[1] - 5))


def cube(picture):
    """The middle of the orientation cube, seen straight ahead, and half of its edge in pixels."""
    part = picture.astype(int)
    face = np.abs(part - CUBE_FACE).max(axis=2) <= 6
    rows, columns = np.nonzero(face)
    return (int(np.median(columns)), int(np.median(rows))), np.sqrt(rows.size) / 2


class Sides(DaemonTest):
    """A box at the left, anterior and superior of the middle."""

    # By key: what is at the right and at the top.
    LOOKS = {"1": ("L", "S"), "2": ("R", "S"), "3": ("P", "S"), "4": ("A", "S"), "5": ("R", "A"),
             "6": ("L", "A")}
    TOWARDS = {"L": 1, "R": -1, "A": 1, "P": -1, "S": 1, "I": -1}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        daemon = cls.daemon
        cls.load("box", 20)
        cls.window = Window(cls.enterClassContext(Screen()), daemon.folder, "--socket",
                            daemon.socket, "--no-overlay", "--color", "0,255,0", "--camera",
                            "anterior")  # looks at the middle of the volume, not of the box
        cls.addClassCleanup(cls.window.end)
        cls.window.wait_for_title("Palpate: box.nrrd")

    @classmethod
    def load(cls, name, first):
        """A box with flat sides: 16 voxels of 1.5 mm along x, from this one."""
        at = np.indices((40, 40, 40))
        inside = ((at[0] >= first) & (at[0] < first + 16) & (at[1] >= 6) & (at[1] < 16)
                  & (at[2] >= 24) & (at[2] < 34))
        path = cls.daemon.folder / f"{name}.nrrd"
        path.write_bytes(nrrd(200.0 * inside, np.diag((1.5, 1.5, 1.5)).tolist(), (1, 2, 3)))
        cls.conn.volume.load(path)
        cls.conn.settings.isovalue = 100.0

    def surface(self):
        """Rows and columns of its pixels in the view, from the view's middle."""
        picture = np.asarray(self.window.picture("s")).astype(int)
        green = picture[..., 1] > picture[..., [0, 2]].max(axis=2) + 40
        rows, columns = np.nonzero(green)
        return rows - green.shape[0] / 2, columns - green.shape[1] / 2

    def looks_from(self, key):
        right, up = self.LOOKS[key]
        rows, columns = self.surface()
        return (columns.size > 200 and np.sign(columns.mean()) == self.TOWARDS[right]
                and np.sign(-rows.mean()) == self.TOWARDS[up])

    def test_keys_look_from_the_patients_sides(self):
        for key in "1264531":
            self.window.do("key", key)
            self.assertTrue(wait_until(lambda k=key: self.looks_from(k)), key)

    def test_a_click_on_the_cube_looks_from_there(self):
        self.window.do("key", "1")
        self.assertTrue(wait_until(lambda: self.looks_from("1")))
        (x, y), half = cube(np.asarray(self.window.picture()))
        self.assertGreater(half, 10)
        # Turned a little to the right the left side appears at the right: the drag turns 40 degrees.
        middle = np.array((x - 300, y + 150))
        self.window.do("mousemove", *middle, "mousedown", 1)
        self.window.do("mousemove", middle[0] - 50, middle[1])
        self.window.do("mousemove", middle[0] - 100, middle[1], "mouseup", 1)
        self.window.click(x + int(1.2 * half), y)
        self.assertTrue(wait_until(lambda: self.looks_from("3")))

    def test_two_clicks_on_the_surface_are_its_length(self):
        # In the middle nothing but its front is seen, which is flat.
        self.load("middle", 12)
        self.window.wait_for_title("Palpate: middle.nrrd")
        self.window.do("key", "1")
        self.assertTrue(wait_until(lambda: abs(self.surface()[1].mean()) < 2.0))
        picture = np.asarray(self.window.picture()).astype(int)
        green = picture[..., 1] > picture[..., [0, 2]].max(axis=2) + 40
        # Not the bars that are green.
        green[:100] = green[:, :320] = green[:, 960:] = False
        rows = np.nonzero(green)[0]
        y = int(np.median(rows))
        line = np.flatnonzero(green[y])
        left, right = int(line[0]) + 6, int(line[-1]) - 6
        # Between the values of 0 and 200 the surface is in the middle.
        per_px = 24.0 / line.size
        mm = per_px * (right - left)
        self.window.do("key", "m")
        self.window.click(left, y)
        self.window.click(right, y)
        self.window.do("mousemove", 20, 780)
        likest = [0.0]

        def is_shown():
            seen = self.window.picture().crop((left, y - 60, right + 60, y + 60))
            likest[0] = max(np.arange(round(mm - 3, 1), mm + 3, 0.1),
                            key=lambda n: likeness_of(f"{n:.1f} mm", seen))
            return places_of(f"{likest[0]:.1f} mm", seen)

        self.assertTrue(wait_until(is_shown), mm)
        shown = likest[0]
        self.assertLessEqual(abs(shown - mm), 2 * per_px + 0.05)
        self.window.do("key", "Delete")
        self.window.do("key", "m")
