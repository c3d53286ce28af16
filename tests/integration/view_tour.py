#!/usr/bin/python3
"""Takes a picture of each thing that the viewer's window offers, with real clicks and keys, to be
looked at. It judges nothing.

    tests/integration/view_tour.py FOLDER [NAME...]

Needs a build in build/, Xvfb and xdotool, and the volumes of PALPATE_DATA_DIR (default:
../shared/data). NAME: one of the pictures; default: all.
"""

import os
import pathlib
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
BIN = pathlib.Path(os.environ.get("PALPATE_BIN", ROOT / "build" / "bin"))
for variable, program in (("PALPATED", "palpated"), ("PALPATE", "palpate"),
                          ("PALPATE_VIEW", "palpate-view")):
    os.environ.setdefault(variable, str(BIN / program))
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "build" / "python")]

from support import Daemon  # noqa: E402: the environment comes first
from view_support import Screen, Window  # noqa: E402

DATA = pathlib.Path(os.environ.get("PALPATE_DATA_DIR", ROOT.parent / "shared" / "data"))
HEAD = DATA / "paper" / "SUBST_head_ct_cranium_256x256x108_int16.nrrd"
MIDDLE = (640, 330)


class Tour:
    def __init__(self, folder, names):
        self.folder = pathlib.Path(folder).resolve()
        self.folder.mkdir(parents=True, exist_ok=True)
        self._names = names
        self.window = None

    def open(self, screen, *arguments):
        self.window = Window(screen, self.folder, *arguments)

    def keep(self, name, wait_s=1.5):
        """Keeps a picture of the window, once it has settled."""
        time.sleep(wait_s)
        picture = self.window.picture()
        for taken in self.folder.glob("palpate-*.png"):
            taken.unlink()
        if not self._names or name in self._names:
            picture.save(self.folder / f"{name}.png")
            print(name, flush=True)

    def over(self, x, y, *commands):
        self.window.do("mousemove", x, y, *commands)


def without_daemon(tour, screen):
    tour.open(screen, "--socket", str(tour.folder / "none.sock"))
    tour.keep("start", 4)
    tour.window.end()


def surface(tour):
    window = tour.window
    tour.keep("first", 6)
    for key, name in (("1", "anterior"), ("3", "left")):
        window.do("key", key)
        tour.keep(name, 3)
    window.do("key", "t")
    tour.keep("light")
    window.do("key", "t", "key", "d")
    tour.keep("plots", 3)
    window.do("key", "d", "key", "F1")
    tour.keep("help")
    window.do("key", "F1")


def hand(tour):
    tour.over(*MIDDLE, "key", "g")
    time.sleep(3)
    for step in range(60):
        tour.over(MIDDLE[0] - 60 + 2 * step, MIDDLE[1] + step // 2)
        time.sleep(0.03)
    tour.keep("hand", 0.5)
    tour.window.do("mousedown", 1)
    tour.keep("hand-pressing", 1)
    tour.window.do("mouseup", 1, "key", "2")
    tour.keep("hand-from-behind", 3)
    tour.window.do("key", "g", "key", "3")


def measures(tour):
    window = tour.window
    time.sleep(2)
    window.do("key", "m")
    window.click(600, 260)
    window.click(700, 380)
    tour.keep("distance")
    window.do("key", "m")
    tour.over(410, 690, "click", "--repeat", 2, "--delay", 60, 1)
    tour.keep("slice-fills", 3)
    tour.over(640, 330, "mousedown", 3, "mousemove", 700, 300, "mouseup", 3)
    tour.keep("slice-window", 2)
    tour.over(640, 330, "click", "--repeat", 2, "--delay", 60, 1)
    time.sleep(2)


def editing(tour):
    window = tour.window
    window.do("key", "b")
    tour.over(640, 300)
    tour.keep("brush")
    window.drag([(580 + 12 * step, 300) for step in range(10)])
    window.do("mousemove", 640, 20, "key", "b")
    tour.keep("stroke", 4)
    window.tab("Edit")
    tour.keep("edit")
    window.do("key", "ctrl+z")
    window.tab("Cut")
    window.press("Plane 1")
    tour.keep("cut", 4)
    window.press("Plane 1")
    window.tab("Look")
    tour.keep("look")
    window.tab("Surface")


def session(tour, conn):
    window = tour.window
    conn.settings.isovalue = 400.0
    tour.keep("changed-by-another", 1)
    conn.settings.isovalue = 300.0
    # Room for what is below.
    window.press("Feel, for everyone")
    window.press("1 person")
    tour.keep("people")
    window.do("key", "Escape")
    tour.keep("escape", 0.2)
    time.sleep(2)
    window.press("Record")
    time.sleep(3)
    tour.keep("recording", 1)
    window.press("what happened")
    window.do("type", "here")
    window.press("Mark")
    window.press("End recording")
    time.sleep(2)
    window.press("Replay")
    tour.keep("replay", 1)
    window.press("Live again")
    window.press("File")
    tour.keep("file-menu")


def main():
    folder, *names = sys.argv[1:] or sys.exit(__doc__)
    tour = Tour(folder, names)
    with Screen() as screen:
        without_daemon(tour, screen)
    with Daemon(HEAD, more=("--isovalue", "300")) as daemon, daemon.connect() as conn:
        with Screen() as screen:
            tour.open(screen, "--socket", daemon.socket)
            surface(tour)
            hand(tour)
            measures(tour)
            editing(tour)
            session(tour, conn)
            tour.window.end()
            tour.open(screen, "--socket", daemon.socket, "--size", "800x600")
            tour.keep("800x600", 6)
            tour.window.end()
        with Screen(2560, 1440) as screen:
            tour.open(screen, "--socket", daemon.socket, "--size", "2560x1440")
            tour.keep("2560x1440", 8)
            tour.window.press("2 \N{MULTIPLICATION SIGN} 2")
            tour.keep("four-panes", 3)
            tour.window.end()
        with Screen() as screen:
            tour.open(screen, "--socket", daemon.socket)
            time.sleep(5)
            daemon.process.kill()
            tour.keep("palpated-killed", 4)
            tour.window.end()
    with Daemon("builtin:gyroid:512") as daemon, Screen() as screen:
        tour.open(screen, "--socket", daemon.socket)
        tour.keep("large", 1)
        tour.window.end()


if __name__ == "__main__":
    main()
