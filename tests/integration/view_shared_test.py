"""palpate-view in a window: what is for everyone, who changed it, and undo among changes of others."""

import numpy as np
import palpate
from secured import SecuredDaemon
from support import DaemonTest, wait_until
from view_support import RIGHT, Screen, Window


class SharedWindow(DaemonTest):
    """A window of the token "operator"; `conn` is another client, of the token "editor"."""

    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(SecuredDaemon())
        cls.conn = cls.enterClassContext(palpate.connect(
            cls.daemon.address, tls_ca=str(cls.daemon.authority.ca),
            token_file=str(cls.daemon.tokens["editor"])))
        # Without the stylus a view that nobody turns stays the same.
        cls.window = Window(cls.enterClassContext(Screen()), cls.daemon.folder, "--server",
                            cls.daemon.address, "--tls-ca", cls.daemon.authority.ca,
                            "--token-file", cls.daemon.tokens["operator"], "--no-overlay")
        cls.addClassCleanup(cls.window.end)
        cls.window.wait_for_title("Palpate: builtin:sphere:48")

    def setUp(self):
        self.window.tab("Surface")

    def isovalue_is(self, value):
        return wait_until(lambda: abs(self.conn.settings.isovalue - value) < 1e-9)

    def drag_isovalue(self, value):
        """From this value, which the other client sets, by dragging the number; the new value."""
        self.conn.settings.isovalue = value
        x, y = self.window.find(str(value))
        self.window.drag([(x + step, y) for step in range(0, 61, 10)])
        self.assertTrue(wait_until(lambda: self.conn.settings.isovalue > value + 0.02))
        return self.settled()

    def settled(self):
        seen = []

        def still():
            self.window.picture()
            seen.append(self.conn.settings.isovalue)
            return len(seen) > 1 and seen[-1] == seen[-2]

        self.assertTrue(wait_until(still))
        return seen[-1]

    def test_a_drag_is_one_step_for_undo_and_redo(self):
        dragged = self.drag_isovalue(0.4375)
        self.window.do("key", "ctrl+z")
        self.assertTrue(self.isovalue_is(0.4375), self.conn.settings.isovalue)
        self.window.do("key", "ctrl+y")
        self.assertTrue(self.isovalue_is(dragged), self.conn.settings.isovalue)
        self.window.do("key", "ctrl+z")
        self.assertTrue(self.isovalue_is(0.4375), self.conn.settings.isovalue)

    def test_what_another_changed_since_stays_and_the_line_names_them(self):
        self.drag_isovalue(0.4375)
        self.conn.settings.isovalue = 0.6125
        self.window.find("0.6125")
        self.window.do("key", "ctrl+z")
        self.assertTrue(wait_until(lambda: self.window.shows("changed since by token editor")))
        self.assertEqual(self.conn.settings.isovalue, 0.6125)

    def test_steps_of_all_kinds_are_undone_in_their_order(self):
        before = self.conn.volume.download().values
        self.drag_isovalue(0.4375)
        x, y = 640, 322  # the middle of the view, whatever is beside it
        revision = self.conn.volume.info().volume_revision
        self.window.do("key", "b")
        self.window.drag([(x + step, y) for step in range(-20, 21, 5)])
        self.window.do("key", "b")
        self.assertTrue(wait_until(
            lambda: self.conn.volume.info().volume_revision > revision), "no edit came")
        dragged = self.conn.settings.isovalue
        self.window.do("key", "ctrl+z")
        self.assertTrue(wait_until(
            lambda: np.array_equal(self.conn.volume.download().values, before)))
        self.assertEqual(self.conn.settings.isovalue, dragged)
        self.window.do("key", "ctrl+z")
        self.assertTrue(self.isovalue_is(0.4375))
        self.window.do("key", "ctrl+y", "key", "ctrl+y")
        self.assertTrue(self.isovalue_is(dragged))
        self.assertTrue(wait_until(
            lambda: not np.array_equal(self.conn.volume.download().values, before)))
        self.window.do("key", "ctrl+z", "key", "ctrl+z")
        self.assertTrue(self.isovalue_is(0.4375))
        np.testing.assert_array_equal(self.conn.volume.download().values, before)

    def test_undo_ends_the_stroke_that_is_in_hand(self):
        def values():
            return self.conn.volume.download().values

        before = values()
        x, y = 640, 322
        self.window.do("key", "b")
        self.window.do("mousemove", x - 20, y, "mousedown", 1)
        self.window.do("mousemove", x - 10, y)
        self.assertTrue(wait_until(lambda: not np.array_equal(values(), before)), "no edit came")
        self.window.do("key", "ctrl+z")
        self.window.picture()
        # The pointer goes on.
        for step in range(0, 21, 5):
            self.window.do("mousemove", x + step, y)
            self.window.picture()
        self.window.do("mouseup", 1, "key", "b")
        self.assertTrue(wait_until(lambda: np.array_equal(values(), before)))
        self.window.do("key", "ctrl+y")
        self.assertTrue(wait_until(lambda: not np.array_equal(values(), before)))
        self.window.do("key", "ctrl+z")
        self.assertTrue(wait_until(lambda: np.array_equal(values(), before)))

    def test_a_clip_plane_is_undone_here_alone(self):
        def view():
            return np.asarray(self.window.picture("s"))

        self.window.tab("Cut")
        # On and off again: by then all of the volume is here.
        pictures = []

        def still():
            pictures.append(view())
            return len(pictures) > 1 and np.array_equal(*pictures[-2:])

        for _ in range(2):
            self.window.press("Plane 1")
            self.assertTrue(wait_until(still))
        whole = pictures[-1]
        self.window.press("Plane 1")
        self.assertTrue(wait_until(lambda: not np.array_equal(view(), whole)))
        self.window.do("key", "ctrl+z")
        self.assertTrue(wait_until(lambda: np.array_equal(view(), whole)))

    def test_who_is_here_and_who_changed_what(self):
        self.window.press("2 people")
        for text in ("token operator (you)", "token editor", "watches"):
            self.window.find(text)
        self.conn.settings.stiffness_n_per_mm = 0.625
        # In the view, for some seconds.
        self.assertTrue(wait_until(lambda: self.window.shows("stiffness by token editor at")))
