"""Esc in the window: what is open is closed, and the second press stops the forces. Whatever the
tool is, and whatever lies over STOP."""

import time
import unittest

import palpate
from support import DaemonTest, wait_until
from view_support import LEFT, STATE, VIEW, Screen, Window

TOP = (0, 0, 1280, 40)
DIALOG = (306, 104, 974, 776)
# What is open: how it is opened, and a text that it shows with the place of that.
THINGS = {
    "help": (lambda window: window.do("key", "F1"), "Esc twice", None),
    "connection": (lambda window: window.do("key", "ctrl+k"), "Reconnect", DIALOG),
    "menu": (lambda window: window.press("File", within=TOP), "Type a path", None),
    "people": (lambda window: window.press("1 person", within=TOP), "watches", None),
    "path": (lambda window: (window.press("File", within=TOP), window.press("Type a path")),
             "a folder of DICOM", DIALOG),
    "problem": (lambda window: (window.press("File", within=TOP), window.press("Type a path"),
                                window.do("type", "none.nrrd"), window.do("key", "Return")),
                "there is no file", None),
}
TOOLS = ("", "g", "b", "m")


class Escape(DaemonTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.window = Window(cls.enterClassContext(Screen()), cls.daemon.folder, "--socket",
                            cls.daemon.socket)
        cls.addClassCleanup(cls.window.end)
        cls.window.wait_for_title("Palpate: builtin:sphere:48")

    def setUp(self):
        self.enable()

    def enable(self):
        self.window.picture()  # the window has handled each press before this one
        self.conn.device.enable()
        self.assertTrue(wait_until(lambda: self.forces() == palpate.ForceState.ON))
        # The next Esc is a first one.
        time.sleep(1.1)

    def forces(self):
        return self.conn.device.info().forces.state

    def escape(self):
        self.window.do("key", "Escape")

    def stopped(self):
        return wait_until(lambda: self.forces() == palpate.ForceState.STOPPED)

    def test_a_half_distance_goes_first(self):
        self.window.do("key", "m")
        self.window.picture()
        self.window.click(*VIEW)
        self.window.picture()
        self.escape()
        time.sleep(1.1)
        self.window.picture()
        self.assertEqual(self.forces(), palpate.ForceState.ON)
        self.escape()
        self.assertTrue(self.stopped())
        self.window.do("key", "m")

    def test_it_closes_each_thing_with_each_tool_and_the_second_press_stops(self):
        for tool in TOOLS:
            if tool:
                self.window.do("key", tool)
            for name, (open_it, text, place) in THINGS.items():
                with self.subTest(tool=tool, open=name):
                    open_it(self.window)
                    self.window.find(text, within=place)
                    time.sleep(1.1)  # the Esc before is no first press of this one
                    self.escape()
                    self.assertTrue(wait_until(lambda t=text, p=place: not self.window.shows(t, p)))
                    self.assertEqual(self.forces(), palpate.ForceState.ON)
            # Nothing is open.
            time.sleep(1.1)
            self.escape()
            self.assertTrue(self.stopped(), tool)
            self.enable()
            self.window.do("key", "F1", "key", "Escape", "key", "Escape")
            self.assertTrue(self.stopped(), tool)
            self.enable()
            self.window.do("key", "Escape", "key", "Escape")
            self.assertTrue(self.stopped(), tool)
            self.enable()
            if self.window.shows("Esc twice"):
                self.window.do("key", "F1")
            if tool:
                self.window.do("key", tool)

    def test_the_banner_says_what_the_next_press_does(self):
        def says():
            return self.window.shows("Esc again stops the forces", within=STATE)

        def says_after_closing():
            self.window.do("key", "F1")
            self.window.find("Esc twice")
            time.sleep(1.1)
            self.escape()
            return says()

        self.assertFalse(says())
        self.assertTrue(wait_until(says_after_closing))
        self.assertTrue(wait_until(lambda: not says()))
        self.assertEqual(self.forces(), palpate.ForceState.ON)

    def test_stop_is_pressed_through_whatever_lies_over_it_and_stops_once(self):
        x, y = self.window.find("STOP FORCES", within=TOP)
        for name, (open_it, text, place) in THINGS.items():
            with self.subTest(open=name):
                self.enable()
                open_it(self.window)
                self.window.find(text, within=place)
                self.window.do("mousemove", x, y, "mousedown", 1)
                self.assertTrue(self.stopped())
                self.enable()
                self.window.do("mouseup", 1)
                time.sleep(1.1)
                self.assertEqual(self.forces(), palpate.ForceState.ON)
                self.escape()
                time.sleep(1.1)  # with nothing open it has stopped them by then
        self.assertEqual(self.window.find("STOP FORCES", within=TOP), (x, y))

    def test_a_key_presses_stop_after_a_press_that_was_drawn_off_it(self):
        x, y = self.window.find("STOP FORCES", within=TOP)
        button = (x - 80, y - 16, x + 80, y + 16)
        plain = self.window.picture().crop(button)
        self.window.do("mousemove", x, y, "mousedown", 1)
        self.assertTrue(self.stopped())
        self.window.do("mousemove", 1, 1, "mouseup", 1)
        self.enable()
        self.assertTrue(wait_until(lambda: self.window.picture().crop(button) == plain))
        # The first key shows where the keyboard is. One space, when that is seen: another could
        # stop what the next test enables.
        self.window.do("key", "Right")
        self.assertTrue(wait_until(lambda: self.window.picture().crop(button) != plain))
        self.window.do("key", "space")
        self.assertTrue(self.stopped())


if __name__ == "__main__":
    unittest.main()
