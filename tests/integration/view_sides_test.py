"""Left is left: slices and view of a volume show the patient's sides, whatever its orientation."""

import pathlib
import tempfile
import unittest

import numpy as np
from PIL import Image
from support import Daemon, nrrd
from view_support import (SLICE_STEP, SLICE_WIDTH, SLICES, VIEW_AREA, WITHOUT_DISPLAY,
                          run_view)

SIZE = np.array((28, 24, 20))
# From the volume's middle, in halves of its axes: where the lump is.
LUMP = np.array((0.5, -0.4, 0.45))
LPS = np.diag((1.0, 1.2, 1.5))
RAS = np.diag((-1.0, -1.2, 1.5))
# Below the legend.
VIEW = (slice(VIEW_AREA[1] + 58, VIEW_AREA[3]), slice(VIEW_AREA[0], VIEW_AREA[2]))
LETTER = 12  # of the edges of the slices, to the middles of the letters there


def lump():
    """A ball, with values that rise towards it everywhere, so that each slice tells."""
    at = (np.indices(SIZE).T / (SIZE - 1) * 2 - 1).T
    towards = np.tensordot(np.sign(LUMP), at, 1) / 3
    ball = 250 - 100 * np.linalg.norm((at.T - LUMP), axis=-1).T / 0.45
    return np.maximum(75 + 75 * towards, ball)


def slice_area(number):
    left = SLICES[0] + SLICE_STEP * number
    return left, SLICES[1], left + SLICE_WIDTH, SLICES[3]


def brighter(picture, number):
    """(right, up) of a slice: 1 where that half is the brighter one, otherwise -1. Letters and
    caption are beside what is looked at."""
    left, top, right, bottom = slice_area(number)
    middle_x, middle_y = (left + right) // 2, (top + bottom) // 2
    part = picture[middle_y - 60:middle_y + 60, middle_x - 60:middle_x + 60]
    gray = part.astype(float).mean(axis=2)
    near, far, middle = slice(0, 40), slice(80, 120), slice(40, 80)
    return (np.sign(gray[middle, far].mean() - gray[middle, near].mean()),
            np.sign(gray[near, middle].mean() - gray[far, middle].mean()))


class Sides(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def look(self, content, *arguments):
        path = self.folder / "volume.nrrd"
        path.write_bytes(content)
        with Daemon(path, more=("--normalized-isovalue", "0.8")) as daemon:
            return [self.draw(daemon, *more) for more in arguments or [()]]

    def draw(self, daemon, *arguments):
        path = self.folder / "picture.png"
        code, _, problem = run_view("--socket", daemon.socket, "--offscreen", "--overwrite",
                                    "--screenshot", path, "--panels", "--camera", "0,10", "--color", "0,255,0",
                                    "--no-overlay", *arguments, env=WITHOUT_DISPLAY)
        self.assertEqual((code, problem), (0, ""))
        return np.asarray(Image.open(path).convert("RGB")).astype(int)

    def assert_sides(self, picture, lump_mm, neurological=False):
        """lump_mm: from the middle, to the left, to posterior, to superior."""
        left, posterior, superior = np.sign(lump_mm)
        right = -left if neurological else left
        shown = [brighter(picture, number) for number in range(3)]
        self.assertEqual(shown, [(posterior, superior), (right, superior), (right, -posterior)])
        view = picture[VIEW]
        green = view[..., 1] > view[..., [0, 2]].max(axis=2) + 40
        self.assertGreater(green.sum(), 300)
        middle = green.shape[1] / 2
        self.assertEqual(np.sign(np.nonzero(green)[1].mean() - middle), left)

    def test_the_same_voxels_in_two_spaces(self):
        lps = nrrd(lump(), LPS.T.tolist())
        ras = lps.replace(b"left-posterior-superior", b"right-anterior-superior")
        self.assert_sides(self.look(lps)[0], LPS @ LUMP)
        self.assert_sides(self.look(ras)[0], RAS @ LUMP)

    def test_axes_of_the_file_in_another_order_and_oblique(self):
        turned = LPS[[2, 0, 1]] * np.array((1, -1, 1))
        angle = np.radians(20)
        oblique = np.array(((np.cos(angle), -np.sin(angle), 0),
                            (np.sin(angle), np.cos(angle), 0), (0, 0, 1))) @ RAS
        for axes in (turned, oblique):
            with self.subTest(axes=axes.tolist()):
                self.assert_sides(self.look(nrrd(lump(), axes.T.tolist()))[0], axes @ LUMP)

    def test_left_can_be_at_the_left_and_letters_can_be_hidden(self):
        plain, neurological, bare = self.look(nrrd(lump(), LPS.T.tolist()), (), ("--neurological",),
                                              ("--no-letters",))
        self.assert_sides(neurological, LPS @ LUMP, neurological=True)
        self.assert_sides(bare, LPS @ LUMP)
        changed = (plain != bare).any(axis=2)
        for number in range(3):
            left, top, right, bottom = slice_area(number)
            x, y = (left + right) // 2, (top + bottom) // 2
            for y, x in ((y, left + LETTER), (y, right - LETTER), (top + LETTER, x),
                         (bottom - LETTER, x)):
                self.assertTrue(changed[y - 8:y + 8, x - 8:x + 8].any(), (number, y, x))
        # At least L, R, and those above and below.
        self.assertGreater(changed[VIEW].sum(), 60)
        # The letters of left and right change places; those of the view stay.
        swapped = (neurological != plain).any(axis=2)
        self.assertFalse(swapped[VIEW].any())
        left, top, _, bottom = slice_area(2)
        middle = (top + bottom) // 2
        self.assertTrue(swapped[middle - 8:middle + 8, left + 2:left + 18].any())
