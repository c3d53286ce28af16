"""The frame of palpate-view's window: what fits, what the user changes of it, and what it
remembers."""

import json
import pathlib
import time

import numpy as np
from support import DaemonTest, wait_until
from view_support import LEFT, PLOTS_BAR, RIGHT, TABS, TOOLS, VIEW, Screen, Window

VOLUME = "Palpate: builtin:sphere:48"


def lightness(picture, area):
    return float(np.asarray(picture.crop(area).convert("L")).mean())


class Layout(DaemonTest):
    def open(self, screen, *arguments):
        window = Window(screen, self.daemon.folder, "--socket", self.daemon.socket, "--no-overlay",
                        *arguments)
        self.addCleanup(window.end)
        window.wait_for_title(VOLUME)
        return window

    def whole(self):
        return self.open(self.enterContext(Screen()))

    def view_size(self, window):
        return window.picture("s").size

    def remembered(self, screen):
        path = pathlib.Path(screen.env["XDG_STATE_HOME"]) / "palpate" / "view.json"
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}

    def test_small_windows_show_all_that_matters(self):
        for width, height in ((800, 600), (640, 400)):
            with self.subTest(width=width), Screen(width, height) as screen:
                # Without --size, a window is as large as the screen lets it.
                size = () if width == 800 else ("--size", f"{width}x{height}")
                window = self.open(screen, *size)
                self.assertEqual(window.picture().size, (width, height))
                for text in ("STOP", "Surface", "Look", "Cut", "Edit", "Hand", "Brush",
                             "Measure", "Show plots (D)", "forces on"):
                    window.find(text)
                seen = self.view_size(window)
                self.assertGreaterEqual(seen[0], width // 2)
                self.assertGreaterEqual(seen[1], 200)
                # The other side comes in place of this one, and keeps half of the window.
                window.click(width - 20, 88)
                window.find("Stiffness")
                self.assertFalse(window.shows("Isovalue"))
                self.assertGreaterEqual(self.view_size(window)[0], width // 2)
                window.end()

    def test_tabs_are_chosen_by_pointer_and_keyboard(self):
        window = self.whole()
        for tab, shows in (("Look", "Colour map"), ("Cut", "Whole volume"), ("Edit", "Radius"),
                           ("Surface", "of range")):
            window.tab(tab)
            window.find(shows, within=LEFT)
        # To the tabs of the left side, one further, and press.
        window.press("Hand (G)", within=TOOLS)
        window.picture()
        window.do("key", "F6")
        window.picture()
        window.do("key", "Right")
        window.picture()
        window.do("key", "space")
        window.find("Colour map", within=LEFT)
        # Letters are the view's, whatever has the keyboard.
        before = self.view_size(window)
        window.do("key", "p")
        self.assertTrue(wait_until(lambda: self.view_size(window)[0] > before[0] + 500))

    def test_the_keyboard_presses_a_control(self):
        window = self.whole()
        window.press("Edit", within=TABS)
        before = self.conn.settings.normalized_isovalue
        window.press("Hand (G)", within=TOOLS)
        window.picture()
        window.do("key", "Right")
        window.picture()
        window.do("key", "space")
        x, y = window.find("Brush (B)", within=TOOLS)

        def is_chosen():
            red, _, blue = window.picture().getpixel((x, y - 8))
            return blue > red + 100

        self.assertTrue(wait_until(is_chosen))
        self.assertEqual(self.conn.settings.normalized_isovalue, before)

    def test_what_was_changed_is_there_after_a_restart(self):
        with Screen() as screen:
            window = self.open(screen)
            size = self.view_size(window)
            window.tab("Look")
            window.drag([(303, 400), (296, 400), (253, 400)])
            self.assertTrue(wait_until(lambda: self.view_size(window)[0] > size[0] + 30))
            window.do("key", "t", "key", "d")
            window.find("Depth, mm")
            window.click(960, 88)  # hides the right side
            self.assertTrue(wait_until(lambda: not window.shows("Device", within=RIGHT)))
            kept = self.view_size(window)
            self.assertTrue(wait_until(lambda: not self.remembered(screen).get("right_shown", True)))
            self.assertEqual(window.end(), (0, ""))
            window = self.open(screen)
            window.find("Colour map", within=LEFT)
            window.find("Depth, mm")
            self.assertEqual(self.view_size(window), kept)
            self.assertGreater(lightness(window.picture(), (20, 500, 280, 600)), 200)

    def test_a_damaged_file_or_folder_is_no_obstacle(self):
        for content in (b"{", b"\xff\x00", None):
            with self.subTest(content=content), Screen() as screen:
                folder = pathlib.Path(screen.env["XDG_STATE_HOME"]) / "palpate"
                if content is None:
                    folder.write_bytes(b"a file where the folder should be")
                else:
                    folder.mkdir()
                    (folder / "view.json").write_bytes(content)
                window = self.open(screen)
                window.do("key", "t")
                window.find("Hand (G)", within=TOOLS)
                self.assertEqual(window.end(), (0, ""))

    def test_the_light_theme_is_light_and_the_picture_stays(self):
        window = self.whole()
        dark = window.picture()
        window.do("key", "t")
        self.assertTrue(wait_until(
            lambda: lightness(window.picture(), RIGHT) > lightness(dark, RIGHT) + 100))
        light = window.picture()
        for area in (LEFT, TOOLS, PLOTS_BAR, TABS):
            self.assertGreater(lightness(light, area), 150, area)
        x, y = VIEW
        middle = (x - 80, y - 80, x + 80, y + 80)
        self.assertEqual(light.crop(middle).tobytes(), dark.crop(middle).tobytes())
        for text in ("of range", "Surface", "Stiffness", "STOP FORCES (Esc)"):
            window.find(text)
        window.do("key", "t")
        self.assertTrue(wait_until(lambda: lightness(window.picture(), RIGHT) < 80))

    def test_the_size_of_the_text(self):
        window = self.whole()

        def tab_bottom():
            """The lowest bright row of the tabs' texts."""
            part = np.asarray(window.picture().convert("L"))[40:140, 10:120]
            return int((part > 200).any(axis=1).sum())

        before = tab_bottom()
        for _ in range(5):
            window.do("key", "ctrl+plus")
        self.assertTrue(wait_until(lambda: tab_bottom() > 1.2 * before))
        window.do("key", "ctrl+0")
        self.assertTrue(wait_until(lambda: tab_bottom() == before))
        window.do("key", "ctrl+minus")
        self.assertTrue(wait_until(lambda: tab_bottom() != before))
        for _ in range(15):
            window.do("key", "ctrl+plus")
        # At the largest, the view still has its half.
        self.assertGreaterEqual(self.view_size(window)[0], 640)

    def test_the_plots_drawer(self):
        window = self.whole()
        size = self.view_size(window)
        window.press("Show plots (D)", within=PLOTS_BAR)
        for text in ("Force, N", "Depth, mm", "Update", "Missed ticks", "Stream age, ms"):
            window.find(text)
        self.assertLess(self.view_size(window)[1], size[1])
        area = (0, 700, 256, 780)
        first = window.picture().crop(area).tobytes()
        self.assertTrue(wait_until(lambda: window.picture().crop(area).tobytes() != first))
        window.do("key", "d")
        self.assertTrue(wait_until(lambda: self.view_size(window) == size))

    def test_a_recording_shifts_nothing(self):
        window = self.whole()
        place = window.find("Stiffness", within=RIGHT)
        self.conn.recording.start(str(self.daemon.folder / f"{time.time_ns()}.mcap"))
        window.find("End recording")
        self.assertEqual(window.find("Stiffness", within=RIGHT), place)
        self.conn.recording.stop()

    def test_the_keyboard_does_not_drag_the_histogram(self):
        window = self.whole()
        before = self.conn.settings.isovalue
        window.press("Hand (G)", within=TOOLS)
        window.do("key", "F6")
        window.picture()
        # Over the heading to the histogram, while the pointer is elsewhere.
        for key in ("Down", "Down", "space"):
            window.do("key", key)
            window.picture()
        for _ in range(3):
            window.picture()
            self.assertEqual(self.conn.settings.isovalue, before)
