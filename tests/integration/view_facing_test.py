"""Where the patient faces: asked in the window where the file does not say it, then shown."""

import numpy as np
from support import DaemonTest, nrrd, pattern, wait_until
from view_support import Screen, Window

QUESTION = "which way does it face?"


def unoriented(axes):
    """A file with these axes that does not say what they are."""
    content = nrrd(pattern((20, 24, 28)), axes.tolist())
    stated = b"space: left-posterior-superior"
    assert stated in content
    return content.replace(stated, b"space dimension: 3")


class Facing(DaemonTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.load("head", np.diag((2.0, 2.0, 2.0)))
        cls.window = Window(cls.enterClassContext(Screen()), cls.daemon.folder, "--socket",
                            cls.daemon.socket, "--no-overlay")
        cls.addClassCleanup(cls.window.end)
        cls.window.wait_for_title("Palpate: head.nrrd")

    @classmethod
    def load(cls, name, axes):
        path = cls.daemon.folder / f"{name}.nrrd"
        path.write_bytes(unoriented(axes))
        cls.conn.volume.load(path)

    def shows(self, text):
        return wait_until(lambda: self.window.shows(text))

    def test_the_answer_is_asked_kept_and_shown(self):
        self.assertTrue(self.shows("across z"))
        self.window.press(QUESTION)
        for line, word in (("The face points to", "+y"), ("The head points to", "+z")):
            x, y = self.window.find(line)
            self.window.press(word, within=(x - 100, y + 6, x + 400, y + 36))
        self.window.press("Keep for this file")
        self.assertTrue(wait_until(lambda: self.conn.volume.info().patient_axes == "RAS"))
        for plane in ("sagittal", "coronal", "axial"):
            self.assertTrue(self.shows(plane), plane)
        self.assertFalse(self.window.shows(QUESTION))

    def test_turned_slices_are_called_oblique(self):
        angle = np.radians(31.2)
        turn = np.array(((1, 0, 0), (0, np.cos(angle), -np.sin(angle)),
                         (0, np.sin(angle), np.cos(angle))))
        self.load("turned", 2.0 * turn.T)
        self.window.wait_for_title("Palpate: turned.nrrd")
        self.conn.volume.place(face="-y", head="+z")
        self.assertTrue(self.shows("oblique 31°"))
        self.assertTrue(self.window.shows("sagittal"))
        self.assertFalse(self.window.shows("axial") or self.window.shows("coronal"))
