"""palpate-view as a person has it: in a window on a screen of its own, with pointer and keys.

Controls are found by their text. The places below are pixels of the window's layout
(client/view/viewer/layout.h) on 1280 by 800 pixels, as it begins: left, top, right, bottom.
"""

import os
import pathlib
import signal
import subprocess
import tempfile

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


TABS = (0, 40, 306, 80)  # Surface, Look, Cut, Edit
LEFT = (0, 80, 306, 776)  # below the tabs
RIGHT = (974, 40, 1280, 776)
STATE = (306, 40, 974, 72)  # the bar that says whether forces act
TOOLS = (306, 72, 974, 104)
VIEW_AREA = (306, 104, 974, 554)
VIEW = (640, 329)  # its middle
SLICES = (306, 580, 918, 776)
PLOTS_BAR = (0, 776, 1280, 800)
# Of a slice: its width, and the distance of their left edges.
SLICE_WIDTH, SLICE_STEP = 202, 204


class Screen:
    """An X server without a monitor, with a folder for what a viewer remembers."""

    def __init__(self, width=1280, height=800):
        self._size = f"{width}x{height}x24"

    def __enter__(self):
        self._state = tempfile.TemporaryDirectory(prefix="palpate-screen-")
        # It chooses a free number, and says it. Each time that no client is left it would start
        # anew and refuse who comes meanwhile: xdotool's questions, one after the other, are
        # such clients while the window is not there yet.
        self._server = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", self._size, "-nolisten", "tcp",
             "-noreset"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.env = {**os.environ, "DISPLAY": ":" + self._server.stdout.readline().strip(),
                    "XDG_STATE_HOME": self._state.name}
        return self

    def __exit__(self, *_):
        self._server.terminate()
        self._server.wait(PATIENCE_S)
        self._server.stdout.close()
        self._state.cleanup()


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

    def find(self, text, among=0, within=None):
        """The middle of a text in the window, once it is there; `among`: which of several, from
        above; `within`: left, top, right, bottom of where it is looked for. Moves the pointer into
        a corner: where it rests, a tooltip covers what is below."""
        self.do("mousemove", 1, 1)
        places = []

        def is_there():
            places[:] = sorted(self._places_of(text, within), key=lambda place: place[1])
            return len(places) > among

        if not wait_until(is_there):
            raise AssertionError(f"the window does not show '{text}'")
        return places[among]

    def _places_of(self, text, within):
        picture = self.picture()
        if within is None:
            return places_of(text, picture)
        left, top, *_ = within
        return [(left + x, top + y) for x, y in places_of(text, picture.crop(within))]

    def shows(self, text, within=None):
        return bool(self._places_of(text, within))

    def press(self, text, among=0, within=None):
        """Clicks on a text: a button, a tab, a check box."""
        self.click(*self.find(text, among, within))

    def tab(self, name):
        """Opens a tab on the left: Surface, Look, Cut, Edit."""
        self.press(name, within=TABS)

    def end(self, number=signal.SIGTERM):
        """Exit code and what it said."""
        if self._said is None:
            if self.process.poll() is None:
                self.process.send_signal(number)
            _, self._said = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, self._said
