"""palpate-view as a person has it: in a window on a screen of its own, with pointer and keys.

Places are pixels of the window's fixed layout (client/view/app/layout.h) on 1280 by 800 pixels.
"""

import os
import pathlib
import signal
import subprocess

from PIL import Image

from support import PATIENCE_S, wait_until
from text_in_picture import places_of

PALPATE_VIEW = os.environ["PALPATE_VIEW"]
WITHOUT_DISPLAY = {key: value for key, value in os.environ.items()
                   if key not in ("DISPLAY", "WAYLAND_DISPLAY")}


def run_view(*arguments, env=None):
    """palpate-view to its end: exit code, stdout, stderr."""
    done = subprocess.run([PALPATE_VIEW, *map(str, arguments)], capture_output=True, text=True,
                          timeout=PATIENCE_S, env=env, check=False)
    return done.returncode, done.stdout, done.stderr


class Screen:
    """An X server without a monitor, 1280 by 800 pixels."""

    def __enter__(self):
        # It chooses a free number, and says it. Each time that no client is left it would start
        # anew and refuse who comes meanwhile: xdotool's questions, one after the other, are
        # such clients while the window is not there yet.
        self._server = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp",
             "-noreset"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.env = {**os.environ, "DISPLAY": ":" + self._server.stdout.readline().strip()}
        return self

    def __exit__(self, *_):
        self._server.terminate()
        self._server.wait(PATIENCE_S)
        self._server.stdout.close()


class Window:
    """palpate-view in a window that fills a screen, started in `folder`."""

    def __init__(self, screen, folder, *arguments, there=()):
        """there: a command that runs it somewhere else."""
        self._env = screen.env
        self.folder = pathlib.Path(folder)
        self.process = subprocess.Popen([*there, PALPATE_VIEW, *map(str, arguments)], env=self._env,
                                        cwd=self.folder, stdout=subprocess.DEVNULL,
                                        stderr=subprocess.PIPE, text=True)
        self._said = None

    def do(self, *commands):
        """What xdotool says: ("mousemove", 1, 2, "click", 1)."""
        return subprocess.run(["xdotool", *map(str, commands)], env=self._env, timeout=PATIENCE_S,
                              capture_output=True, text=True, check=False).stdout.strip()

    def title(self):
        return self.do("search", "--name", "^Palpate:", "getwindowname")

    def wait_for_title(self, title):
        if not wait_until(lambda: self.title() == title or self.process.poll() is not None,
                          PATIENCE_S) or self.title() != title:
            ended = self.process.poll()
            raise AssertionError(f"the title is '{self.title()}', not '{title}'" + (
                "" if ended is None else f"; it ended with {ended}: {self.process.stderr.read()}"))

    def click(self, x, y):
        self.do("mousemove", x, y, "click", 1)

    def drag(self, points):
        """The left button goes down at the first and up at the last of (x, y)."""
        self.do("mousemove", *points[0], "mousedown", 1)
        for point in points[1:]:
            self.do("mousemove", *point)
        self.do("mouseup", 1)

    def picture(self, key="F12"):
        """The picture that a press of this key saves, of what was clicked before too."""
        before = set(self.folder.glob("palpate-*.png"))
        self.do("key", key)
        new = []

        def came():
            new[:] = set(self.folder.glob("palpate-*.png")) - before
            return bool(new)

        if not wait_until(came):
            raise AssertionError("no picture came")
        return Image.open(new[0]).convert("RGB")

    def find(self, text, among=0):
        """The middle of a text in the window, once it is there; `among`: which of several, from
        above."""
        places = []

        def is_there():
            places[:] = sorted(places_of(text, self.picture()), key=lambda place: place[1])
            return len(places) > among

        if not wait_until(is_there):
            raise AssertionError(f"the window does not show '{text}'")
        return places[among]

    def shows(self, text):
        return bool(places_of(text, self.picture()))

    def press(self, text, among=0):
        """Clicks on a text: a button, a tab, a check box."""
        self.click(*self.find(text, among))

    def end(self, number=signal.SIGTERM):
        """Exit code and what it said."""
        if self._said is None:
            if self.process.poll() is None:
                self.process.send_signal(number)
            _, self._said = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, self._said


class Panels:
    """The headings on one side of a window, with what is below them."""

    LEFT = (10, ("Isovalue", "Look", "Brush", "Crop and cut"))
    RIGHT = (990, ("Device", "Plots", "Recording", "Feel"))
    # A line of text, with the frame that buttons, sliders and headings have, and its distance.
    _ROW = 26

    def __init__(self, window, side):
        self._window = window
        self.x, self._names = side
        # As the window begins: all but the last.
        self._open = list(self._names[:-1])

    @classmethod
    def _y(cls, row):
        return 40 + 8 + cls._ROW * row + 10

    def only(self, name):
        """Closes all but this heading."""
        # From above, so that each is at its row.
        for row, shown in enumerate(self._names):
            if shown in self._open:
                self._window.click(self.x + 100, self._y(row))
        self._window.click(self.x + 100, self._y(self._names.index(name)))
        self._open = [name]

    def row(self, number):
        """The y of a line below the one heading that is open, from 0."""
        return self._y(self._names.index(self._open[0]) + 1 + number)
