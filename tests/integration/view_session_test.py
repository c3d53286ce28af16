"""Recordings made and replayed in a window of palpate-view."""

import contextlib
import threading
import unittest

import numpy as np
import palpate
from support import DaemonTest, wait_until
from view_support import RIGHT, STATE, Screen, Window


class ViewSession(DaemonTest):
    volume = "builtin:gyroid:48"

    def setUp(self):
        self.window = Window(self.enterContext(Screen()), self.daemon.folder, "--socket",
                             self.daemon.socket)
        self.addCleanup(self.window.end)
        self.window.wait_for_title("Palpate: builtin:gyroid:48")
        # Room for the whole panel of the session.
        self.window.press("Feel, for everyone", within=RIGHT)

    def type(self, text):
        for letter in text:
            self.window.do("type", letter)
            self.window.picture()

    def state(self):
        return self.conn.recording.state()

    def becomes(self, holds):
        self.assertTrue(wait_until(holds))

    def banner(self):
        """Whether the view is framed as that of a replay."""
        picture = np.asarray(self.window.picture()).astype(int)
        amber = (np.abs(picture - (250, 184, 41)).sum(axis=2) < 60)
        return bool(amber.sum(axis=1).max() > 300)

    def name(self, name):
        """Of the next recording: in the field below the heading."""
        x, y = self.window.find("Session", within=RIGHT)
        self.window.click(x, y + 26)
        self.window.picture()
        self.window.do("key", "ctrl+a")
        self.window.picture()
        self.type(name)

    def record(self, name, marker):
        """By name: the file in the daemon's folder."""
        self.name(name)
        self.window.press("Record")
        self.becomes(lambda: self.state().running)
        self.becomes(lambda: self.state().ticks > 600)
        self.window.press("what happened")
        self.type(marker)
        self.window.press("Mark")
        self.becomes(lambda: self.window.shows("what happened"))
        ticks = self.state().ticks
        self.becomes(lambda: self.state().ticks > ticks + 1200)

    def test_a_session_is_recorded_listed_and_replayed(self):
        self.assertFalse(self.banner())
        below = self.window.find("Recordings")
        self.record("first", "here")
        # What is below has not moved.
        self.assertEqual(self.window.find("Recordings"), below)
        self.conn.edit.sphere((0, 0, 0), 8.0, "set", 0.5)
        ticks = self.state().ticks
        self.becomes(lambda: self.state().ticks > ticks + 1200)
        self.window.press("End recording")
        self.becomes(lambda: not self.state().running)
        self.conn.edit.revert()
        path = self.daemon.folder / "first.mcap"
        self.assertEqual(self.state().path, str(path))
        self.assertEqual(self.state().size_bytes, path.stat().st_size)
        self.assertEqual([file.path for file in self.conn.recording.list()], [str(path)])

        # The list has it, chosen, and the next name is another one.
        self.becomes(lambda: self.window.shows("first-2"))
        revision = self.conn.volume.info().volume_revision
        self.window.press("Replay")
        self.becomes(self.banner)
        # It cannot be recorded meanwhile.
        self.assertFalse(self.state().running)
        self.window.press("Pause")
        self.becomes(lambda: self.window.shows("Play"))

        # A seek by a click on the timeline, far to its end: the voxels are those of then.
        x, y = self.window.find("Play")
        loaded = self.conn.volume.download().values
        self.window.click(1255, y + 26)
        self.becomes(lambda: not np.array_equal(self.conn.volume.download().values, loaded))
        self.assertGreater(self.conn.volume.info().volume_revision, revision)
        # And back.
        self.window.click(1000, y + 26)
        self.becomes(lambda: np.array_equal(self.conn.volume.download().values, loaded))
        self.assertTrue(self.banner())
        self.window.press("Live again")
        self.becomes(lambda: not self.banner())
        self.becomes(lambda: self.window.shows("live"))

    def test_a_taken_name_is_refused_and_another_one_offered(self):
        self.record("again", "x")
        self.window.press("End recording")
        self.becomes(lambda: not self.state().running)
        size = (self.daemon.folder / "again.mcap").stat().st_size
        self.name("again")
        self.window.press("Record")
        self.window.press("Use again-2")
        self.assertFalse(self.state().running)
        self.window.press("Record")
        self.becomes(lambda: self.state().running)
        self.assertEqual(self.state().path, str(self.daemon.folder / "again-2.mcap"))
        self.assertEqual((self.daemon.folder / "again.mcap").stat().st_size, size)
        self.conn.recording.stop()  # the next test has the same daemon

    def test_somebody_elses_replay_is_no_live_state(self):
        path = self.daemon.folder / "theirs.mcap"
        self.conn.recording.start(path)
        self.becomes(lambda: self.state().ticks > 600)
        self.conn.recording.stop()
        ends = threading.Event()

        def replay():
            with self.daemon.connect() as theirs, contextlib.suppress(palpate.Cancelled):
                theirs.recording.replay(path, 1e-3, progress=lambda _: not ends.is_set())

        self.becomes(lambda: self.window.shows("forces on", within=STATE))
        somebody = threading.Thread(target=replay)
        somebody.start()
        self.addCleanup(somebody.join)
        self.addCleanup(ends.set)
        self.becomes(self.banner)
        self.becomes(lambda: self.window.shows("theirs", within=STATE))
        self.assertFalse(self.window.shows("forces on", within=STATE))
        ends.set()
        self.becomes(lambda: not self.banner())
        self.becomes(lambda: self.window.shows("forces on", within=STATE))

    def test_the_window_outlives_a_daemon_that_ends_while_it_records(self):
        self.name("cut")
        self.window.press("Record")
        self.becomes(lambda: self.window.shows("End recording"))
        self.daemon.end()
        self.window.wait_for_title("Palpate: reconnecting")
        self.daemon.start()
        self.window.wait_for_title("Palpate: builtin:gyroid:48")
        # It asks once a second.
        self.becomes(lambda: self.window.shows("not recording"))
        self.assertIsNone(self.window.process.poll())


if __name__ == "__main__":
    unittest.main()
