"""palpate-view without a display: pictures for scripts."""

import os
import pathlib
import re
import signal
import subprocess
import tempfile
import time
import unittest

import numpy as np
import palpate
from PIL import Image
from support import PATIENCE_S, Daemon, DaemonTest, nrrd, wait_until
from text_in_picture import places_of
from view_support import LEFT, PALPATE_VIEW, WITHOUT_DISPLAY, run_view


def begin_endless(test, daemon):
    """A run that is under way: it follows the volume."""
    process = subprocess.Popen(
        [PALPATE_VIEW, "--socket", daemon.socket, "--offscreen", "--seconds", "600", "--size",
         "64x64", "--screenshot", daemon.folder / "never.png"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    test.addCleanup(process.kill)

    def is_under_way():
        # Libraries start threads of their own, before signals are taken.
        status = pathlib.Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
        caught = int(re.search(r"^SigCgt:\s*(\w+)$", status, re.MULTILINE)[1], 16)
        return (caught >> (signal.SIGTERM - 1) & 1
                and len(os.listdir(f"/proc/{process.pid}/task")) > 3)

    test.assertTrue(wait_until(is_under_way))
    return process


def end_of(process, daemon):
    """Exit code, what it printed, and the lines of its complaint; it left no picture."""
    said, problem = process.communicate(timeout=PATIENCE_S)
    if not problem.startswith("palpate-view: ") or (daemon.folder / "never.png").exists():
        raise AssertionError(problem)
    return process.returncode, said, problem.count("\n")


class Drawn(DaemonTest):
    """Pictures of a daemon's volume."""

    def draw(self, *arguments):
        """The picture, and what was said."""
        path = pathlib.Path(self.daemon.folder) / "picture.png"
        path.unlink(missing_ok=True)
        code, said, problem = run_view("--socket", self.daemon.socket, "--offscreen",
                                       "--screenshot", path, *arguments, env=WITHOUT_DISPLAY)
        self.assertEqual((code, problem), (0, ""))
        self.assertEqual([p.name for p in path.parent.glob("picture*")], ["picture.png"])
        return np.asarray(Image.open(path)), said


class Offscreen(Drawn):
    volume = "builtin:gyroid:64"

    def test_each_option_of_the_view_changes_it(self):
        def look(*options):
            return self.draw("--size", "200x150", "--no-overlay", *options)[0]

        plain = look()
        self.assertEqual(plain.shape, (150, 200, 3))
        self.assertTrue(np.array_equal(plain, look()))
        for options in (("--no-box",), ("--veil", "0.2,0.5"), ("--color", "255,0,0"),
                        ("--coloring", "slope", "--color-map", "viridis"),
                        ("--crop", "0,0.5,0,1,0,1"), ("--target", "20,0,0"),
                        ("--camera", "20,15,100")):
            with self.subTest(options=options):
                self.assertFalse(np.array_equal(plain, look(*options)))

    def test_a_side_of_the_patient_is_refused_until_it_is_known(self):
        picture = self.daemon.folder / "never.png"
        code, said, problem = run_view("--socket", self.daemon.socket, "--offscreen",
                                       "--screenshot", picture, "--camera", "anterior")
        self.assertEqual((code, said, picture.exists()), (2, "", False))
        self.assertRegex(problem, r"^palpate-view: [^\n]*palpate place[^\n]*\n$")
        self.conn.volume.place(face="-x", head="-z")
        sides = [self.draw("--size", "200x150", "--no-overlay", "--camera", side)[0]
                 for side in ("anterior", "left")]
        self.assertFalse(np.array_equal(*sides))

    def test_a_veil_beyond_the_volumes_range_is_refused(self):
        picture = self.daemon.folder / "never.png"
        code, said, problem = run_view("--socket", self.daemon.socket, "--offscreen",
                                       "--screenshot", picture, "--veil", "99999")
        self.assertEqual((code, said, picture.exists()), (2, "", False))
        info = self.conn.volume.info()
        span = re.escape(f"{np.float32(info.value_min)!s} to {np.float32(info.value_max)!s}")
        self.assertRegex(problem, rf"^palpate-view: [^\n]*{span}.*\n$")

    def test_frames_of_a_moving_stylus_cost_one_cast(self):
        _, said = self.draw("--size", "200x150", "--frames", "20")
        self.assertRegex(said, r"^20 frames in [\d.]+ s, 1 casts, ")

    def test_panels_are_drawn_where_they_are_wanted(self):
        picture, _ = self.draw("--panels")
        self.assertEqual(picture.shape, (800, 1280, 3))
        # The emergency stop.
        corner = picture[:40, 1100:].reshape(-1, 3).astype(int)
        self.assertGreater(int(((corner[:, 0] > 150) & (corner[:, 1] < 60)).sum()), 1000)

    def test_a_signal_ends_it(self):
        for number in (signal.SIGTERM, signal.SIGINT):
            process = begin_endless(self, self.daemon)
            process.send_signal(number)
            self.assertEqual(end_of(process, self.daemon), (9, "", 1))


# Convex, so that nothing hides the proxy from the side.
class OfASphere(Drawn):
    volume = "builtin:sphere:48"

    def test_contact_is_waited_for_and_looked_at(self):
        picture, _ = self.draw("--size", "400x300", "--wait-contact", "--wait-gap", "0.0002",
                               "--camera", "profile,12", "--haptic-surface", "--no-box",
                               "--no-stylus")
        # The wireframe of H around the middle, in its colour.
        middle = picture[75:225, 100:300].reshape(-1, 3).astype(int)
        pink = (middle[:, 0] > middle[:, 1] + 60) & (middle[:, 2] > middle[:, 1] + 60)
        self.assertGreater(int(pink.sum()), 20)

    def test_contact_of_a_tool_is_waited_for(self):
        self.conn.settings.tool = palpate.Tool((palpate.ToolBall((0.0, 0.0, 0.0)),))
        self.addCleanup(setattr, self.conn.settings, "tool", None)
        self.conn.settings.wait_for_tool()
        self.draw("--size", "64x64", "--wait-contact")


def ball(shape, radius):
    """A ball in the middle, of values from 0 to 100."""
    at = np.indices(shape).T - (np.array(shape) - 1) / 2
    return np.clip(50 - 10 * (np.linalg.norm(at, axis=-1).T - radius), 0, 100)


class OddVolumes(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def look(self, content, *arguments):
        path = self.folder / "volume.nrrd"
        path.write_bytes(content)
        picture = self.folder / "a.png"
        with Daemon(path) as daemon:
            code, _, problem = run_view("--socket", daemon.socket, "--offscreen", "--screenshot",
                                        picture, "--overwrite", *arguments)
        return code, problem, picture

    def test_a_unit_is_text_whatever_it_is(self):
        whole = nrrd(ball((24, 24, 24), 8))
        for unit in ("%s%s%s%n", "HU", "%" * 300, "a\tb" * 80):
            with self.subTest(unit=unit[:20]):
                content = whole.replace(b"encoding: raw\n",
                                        b'encoding: raw\nsample units: "%s"\n' % unit.encode())
                code, problem, picture = self.look(content, "--panels")
                self.assertEqual((code, problem), (0, ""))
                self.assertEqual(Image.open(picture).size, (1280, 800))

    def test_the_share_of_the_range_is_whole_beside_any_unit(self):
        def share(unit):
            content = whole.replace(b"encoding: raw\n",
                                    b'encoding: raw\nsample units: "%s"\n' % unit)
            picture = Image.open(self.look(content, "--panels")[2])
            (x, y), *_ = places_of("of range", picture.crop(LEFT))
            x, y = x + LEFT[0], y + LEFT[1]
            # A long unit is above it, not beside it. It is bluish, a unit is not.
            line = np.asarray(picture)[y - 10:y + 10, max(0, x - 80):x + 70]
            columns = (line[..., 2] > line[..., 0].astype(int) + 14).any(axis=0).nonzero()[0]
            return int(columns[-1] - columns[0])
        whole = nrrd(ball((24, 24, 24), 8))
        short = share(b"HU")
        self.assertGreater(short, 50)
        self.assertEqual(share(b"W" * 30), short)

    def test_a_volume_longer_than_any_texture_is_drawn(self):
        code, problem, picture = self.look(nrrd(ball((20000, 4, 4), 2)), "--no-overlay", "--no-box",
                                           "--target", "0,0,0")
        self.assertEqual((code, problem), (0, ""))
        self.assertEqual(Image.open(picture).size, (1280, 800))

    def test_too_little_graphics_memory_is_said_and_the_picture_is_whole(self):
        content = nrrd(ball((160, 160, 160), 70))
        view = ("--no-overlay", "--no-box", "--size", "400x300")
        code, problem, picture = self.look(content, *view)
        self.assertEqual((code, problem), (0, ""))
        whole = np.asarray(Image.open(picture)).astype(int)
        code, problem, picture = self.look(content, *view, "--graphics-memory-mib", "1")
        self.assertEqual(code, 0)
        self.assertRegex(problem, r"^palpate-view: [^\n]*graphics-memory-mib[^\n]*\n$")
        coarse = np.asarray(Image.open(picture)).astype(int)
        # Silhouettes and light are nearly the same.
        self.assertFalse(np.array_equal(coarse, whole))
        self.assertLess(np.mean(np.abs(coarse - whole).max(axis=-1) > 40), 0.02)


class OffscreenAlone(unittest.TestCase):
    def test_no_daemon_or_no_folder(self):
        with tempfile.TemporaryDirectory() as folder:
            for name, expected, named in (("a.png", 8, "nobody.sock"),
                                          ("missing/a.png", 4, "missing/a.png"), ("", 3, folder),
                                          ("a.jpg", 2, "a.jpg")):
                code, said, problem = run_view("--socket", folder + "/nobody.sock", "--offscreen",
                                               "--screenshot", folder + "/" + name)
                self.assertEqual((code, said), (expected, ""))
                self.assertRegex(problem, rf"^palpate-view: .*{named}.*\n$")
                self.assertEqual(os.listdir(folder), [])

    def test_a_picture_replaces_only_a_file_and_only_when_told_to(self):
        with Daemon() as daemon:
            picture, pipe = daemon.folder / "a.png", daemon.folder / "pipe.png"
            picture.write_text("precious")
            os.mkfifo(pipe)

            def draw(path, *more):
                return run_view("--socket", daemon.socket, "--offscreen", "--size", "64x64",
                                "--screenshot", path, *more)[0]
            self.assertEqual(draw(picture), 7)
            self.assertEqual(draw(pipe, "--overwrite"), 3)
            self.assertEqual(picture.read_text(), "precious")
            self.assertTrue(pipe.is_fifo())
            self.assertEqual(draw(picture, "--overwrite"), 0)
            self.assertEqual(Image.open(picture).size, (64, 64))

    def test_a_daemon_that_goes_away(self):
        with Daemon() as daemon:
            process = begin_endless(self, daemon)
            # Frames are drawn, or soon would be: of what is no longer there.
            time.sleep(1.0)
            daemon.end(signal.SIGKILL)
            self.assertEqual(end_of(process, daemon), (8, "", 1))

    def test_bad_options_are_refused_with_one_line(self):
        for options in ("--offscreen", "--screenshot a.png", "--frames 3", "--wait-contact",
                        "--panels", "--offscreen --frames 1 --seconds 1", "--offscreen --frames 0",
                        "--offscreen --frames x", "--offscreen --frames 1 --wait-gap 1",
                        "--size 1280", "--size 10x800", "--size 1280x800x2", "--camera 1",
                        "--camera 0,90", "--camera front", "--camera 0,0,0", "--camera nan,0",
                        "--camera profile", "--camera profile,0", "--target here", "--target 1,2",
                        "--veil=", "--veil 1,2", "--color 1,2", "--color 0,0,256",
                        "--color-map rainbow", "--coloring none", "--window 2,1", "--graphics-memory-mib 0",
                        "--graphics-memory-mib much", "--crop 0,1,0,1,0",
                        "--crop 0.5,0.5,0,1,0,1", "--crop 0,2,0,1,0,1", "--socket a --server b:1",
                        "--nonsense", "file.nrrd"):
            with self.subTest(options):
                code, said, problem = run_view(*options.split())
                self.assertEqual((code, said), (2, ""))
                self.assertRegex(problem, r"^palpate-view: [^\n]+\n$")

    def test_help_names_units_and_defaults(self):
        code, said, _ = run_view("--help")
        self.assertEqual(code, 0)
        for word in ("mm", "1280x800", "Exit codes"):
            self.assertIn(word, said)
