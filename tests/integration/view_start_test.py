"""palpate-view for a person with nothing running: from the start page to a volume of their own."""

import contextlib
import os
import pathlib
import signal
import struct
import tempfile
import time
import unittest

import numpy as np
import palpate
from dicom_series import dicom_slice
from support import PALPATED, Daemon, DaemonTest, wait_until
from view_support import Screen, Window

SIZE = 12
# What a person does in the dialog of a desktop: chooses the folder, and presses OK.
CLICKS_IN_DIALOG = 2


def make_series(folder):
    """A ball of bone in air."""
    folder.mkdir()
    for z in range(SIZE):
        voxels = b"".join(
            struct.pack("<h", 1000 if (x - 6) ** 2 + (y - 6) ** 2 + (z - 6) ** 2 < 16 else -1000)
            for y in range(SIZE) for x in range(SIZE))
        (folder / f"slice{z:02}.dcm").write_bytes(dicom_slice(z, SIZE, SIZE, voxels))
    return folder


class Desk(unittest.TestCase):
    """A home without a palpated, and a desktop whose file dialog a script answers."""

    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="palpate-test-")
        self.addCleanup(temporary.cleanup)
        self.home = pathlib.Path(temporary.name)
        (self.home / "bin").mkdir()
        (self.home / "bin" / "palpated").symlink_to(PALPATED)
        self.socket = str(self.home / "palpated.sock")
        self.screen = self.enterContext(Screen())
        self.screen.env.update(
            HOME=str(self.home), XDG_STATE_HOME=str(self.home / "state"), XDG_CURRENT_DESKTOP="",
            XDG_CONFIG_HOME=str(self.home / "config"), PALPATE_SOCKET=self.socket,
            PATH=f"{self.home / 'bin'}:{os.environ['PATH']}")
        self.screen.env.pop("PALPATE_SERVER", None)
        self.clicks = 0

    def open_window(self, *arguments):
        self.window = Window(self.screen, self.home, *arguments)
        self.addCleanup(self.window.end)
        return self.window

    def open_page(self):
        window = self.open_window()
        # Keys that come before the window are lost.
        window.wait_for_title("Palpate: not connected")
        return window

    def dialog_answers(self, path, code=0):
        script = self.home / "bin" / "zenity"
        script.write_text(f"#!/bin/sh\necho \"$@\" >>'{self.home}/asked'\n"
                          f"echo '{path}'\nexit {code}\n")
        script.chmod(0o700)

    def press(self, text, among=0):
        self.window.press(text, among)
        self.clicks += 1

    def source(self):
        with palpate.connect(self.socket) as conn:
            return conn.volume.info().source


class FromTheStartPage(Desk):
    def test_a_dicom_folder_is_touched_after_four_clicks(self):
        series = make_series(self.home / "CT")
        self.dialog_answers(series)
        window = self.open_page()
        self.press("Start here")
        self.press("Open a DICOM folder\N{HORIZONTAL ELLIPSIS}")
        window.wait_for_title("Palpate: CT")
        self.assertLessEqual(self.clicks + CLICKS_IN_DIALOG, 4)
        with palpate.connect(self.socket) as conn:
            self.assertEqual(conn.volume.info().source, str(series))
            with conn.poses() as poses:
                self.assertTrue(any(pose.contact for pose in poses), "nothing is touched")
        # It ends with the window.
        self.assertEqual(window.end()[0], 0)
        self.assertRaises(palpate.Unavailable, self.source)

    def test_opening_starts_palpated_by_itself_and_is_remembered(self):
        series = make_series(self.home / "CT")
        self.dialog_answers(series)
        window = self.open_page()
        self.press("Open a DICOM folder\N{HORIZONTAL ELLIPSIS}")
        window.wait_for_title("Palpate: CT")
        self.assertIn("--directory", (self.home / "asked").read_text())
        window.end()
        # A window of another day.
        (self.home / "bin" / "zenity").unlink()
        window = self.open_page()
        self.press("CT")
        window.wait_for_title("Palpate: CT")
        self.assertEqual(self.source(), str(series))

    def pid(self):
        """Of the palpated that the window started."""
        for link in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
            with contextlib.suppress(OSError):
                words = link.read_bytes().split(b"\0")
                if words[0].endswith(b"palpated") and self.socket.encode() in words:
                    return int(link.parent.name)
        self.fail("no palpated")

    def test_a_palpated_that_was_killed_starts_again_with_its_volume(self):
        series = make_series(self.home / "CT")
        self.dialog_answers(series)
        window = self.open_page()
        self.press("Open a DICOM folder\N{HORIZONTAL ELLIPSIS}")
        window.wait_for_title("Palpate: CT")
        with palpate.connect(self.socket) as conn:
            for value in (100, 200):
                conn.edit.sphere((6, 6, 6), 2, "set", value)
        first = self.pid()
        time.sleep(2)  # it asks once a second how many edits are not saved
        os.kill(first, signal.SIGKILL)
        self.assertTrue(wait_until(lambda: window.shows("signal 9")))
        self.assertTrue(window.shows("lost:"))
        self.press("Start again and reopen")
        self.assertTrue(wait_until(lambda: not window.shows("Start again and reopen")))
        window.wait_for_title("Palpate: CT")
        self.assertNotEqual(self.pid(), first)
        self.assertEqual(self.source(), str(series))

    def test_a_folder_without_a_volume_says_so_and_starts_nothing(self):
        self.dialog_answers(self.home / "nothing")
        window = self.open_page()
        self.press("Open a DICOM folder\N{HORIZONTAL ELLIPSIS}")
        self.assertTrue(wait_until(lambda: window.shows("there is no file")))
        self.assertTrue(window.shows("Start here"))
        self.assertRaises(palpate.Unavailable, self.source)


class InAWindow(DaemonTest):
    def setUp(self):
        Desk.setUp(self)
        self.conn.volume.load("builtin:sphere:48", discard_edits=True)
        self.socket = self.daemon.socket
        self.open_window("--socket", self.socket).wait_for_title("Palpate: builtin:sphere:48")

    open_window, dialog_answers, press = Desk.open_window, Desk.dialog_answers, Desk.press

    def from_menu(self, item):
        self.window.press("File")
        self.window.press(item)

    def source(self):
        return self.conn.volume.info().source

    def test_a_bad_file_gives_one_line_and_the_volume_stays(self):
        bad = self.home / "bad.nrrd"
        bad.write_text("nothing")
        self.dialog_answers(bad)
        self.from_menu("Open file\N{HORIZONTAL ELLIPSIS}")
        self.window.press("Close")
        self.assertEqual(self.source(), "builtin:sphere:48")

    def test_a_dialog_that_is_cancelled_changes_nothing(self):
        # A folder that could be opened.
        self.dialog_answers(make_series(self.home / "CT"), code=1)
        asked = self.home / "asked"

        def asks_again():
            # One dialog at a time: the second one opens when the first one's answer was taken.
            self.window.do("key", "ctrl+o")
            self.window.picture()
            return asked.exists() and len(asked.read_text().splitlines()) > 1

        self.assertTrue(wait_until(asks_again))
        self.assertFalse(self.window.shows("Cancel"))
        self.assertEqual(self.source(), "builtin:sphere:48")

    def test_a_load_is_cancelled(self):
        self.from_menu("Type a path\N{HORIZONTAL ELLIPSIS}")
        self.window.find("Open a path")
        # The field has the keyboard.
        self.window.do("key", "ctrl+a", "type", "builtin:gyroid:384")
        self.window.do("key", "Return")
        self.window.press("Cancel")
        self.window.find("loading was cancelled")
        self.assertEqual(self.source(), "builtin:sphere:48")

    def test_edits_are_lost_only_when_the_user_says_so(self):
        self.conn.edit.sphere((0, 0, 0), 3, "set", 0.25)
        self.window.press("File")
        self.window.press("Samples")
        self.window.press("Gyroid")
        self.window.press("Not now")
        self.assertEqual(self.source(), "builtin:sphere:48")
        self.window.press("File")
        self.window.press("Samples")
        self.window.press("Gyroid")
        self.window.press("Discard and open")
        self.window.wait_for_title("Palpate: builtin:gyroid")

    def test_a_question_is_not_put_to_another_palpated(self):
        self.conn.edit.sphere((0, 0, 0), 3, "set", 0.25)
        self.window.press("File")
        self.window.press("Samples")
        self.window.press("Gyroid")
        self.window.find("Discard and open")
        other = self.enterContext(Daemon("builtin:sphere:32"))
        self.window.do("key", "ctrl+k")
        self.window.press("on this machine; empty: the default one")
        self.window.picture()
        self.window.do("type", other.socket)
        # The dialog does not cover the question.
        self.window.find("Discard and open")
        self.window.press("Connect to it")
        self.window.wait_for_title("Palpate: builtin:sphere:32")
        self.assertFalse(self.window.shows("Discard and open"))

    def test_revert_is_a_step_that_undo_takes_back(self):
        def values():
            return self.conn.volume.download().values

        self.conn.edit.sphere((0, 0, 0), 3, "set", 0.25)
        edited = values()
        self.from_menu("Revert")
        self.assertTrue(wait_until(lambda: not np.array_equal(values(), edited)))

        def is_taken_back():
            # The window learns of the step's end a moment later.
            self.window.do("key", "ctrl+z")
            self.window.picture()
            return np.array_equal(values(), edited)

        self.assertTrue(wait_until(is_taken_back))


if __name__ == "__main__":
    unittest.main()
