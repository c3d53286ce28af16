"""A palpated on another machine, over TLS: every client reaches it by a profile, and sees and
steers as far as its role goes. Why each is refused: sdk_security_test, python_profiles_test."""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np
from authority import Authority
from network import Network
from support import PALPATED, PATIENCE_S, Daemon, wait_until
from view_support import LEFT, Screen, Window

PALPATE = os.environ["PALPATE"]
EXAMPLE = os.environ["PALPATE_SDK_EXAMPLE"]
PORT = 7411
# A place on the histogram; a column of the dialog through its buttons, and their colours, at rest
# and under the pointer.
HISTOGRAM = (100, 160)
DIALOG_X = 372
BUTTON = ((43, 79, 122), (56, 102, 153))

# What a lab script does: poses, voxels, a change.
SCRIPT = """
import sys, palpate
with palpate.connect(profile=sys.argv[1]) as conn:
    for n, poses in zip(range(3), conn.poses()):
        assert poses.tick.size
    print(conn.volume.download().values.shape)
    conn.settings.isovalue = float(sys.argv[2])
    print(conn.settings.isovalue)
"""


class Remote(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix="palpate-remote-")))
        cls.network = cls.enterClassContext(Network())
        cls.authority = Authority(cls.folder, "lab")
        certificate, key = cls.authority.issue("server", f"IP:{Network.SERVER}",
                                               purpose="serverAuth")
        cls.tokens = cls.folder / "tokens.toml"
        # As a person would hand it over, and get it.
        cls.profiles = cls.folder / "config" / "palpate"
        for role in ("viewer", "editor"):
            subprocess.run(
                [PALPATED, "token", "add", role, "--role", role, "--file", cls.tokens, "--days",
                 "30", "--client-folder", cls.profiles, "--server", f"{Network.SERVER}:{PORT}",
                 "--tls-ca", cls.authority.ca, "--profile", role], check=True, capture_output=True)
        config = cls.folder / "palpated.toml"
        config.write_text(f'[tls]\ncertificate = "{certificate}"\nkey = "{key}"\n'
                          f'tokens = "{cls.tokens}"\n')
        # Its socket is on this machine's disk too.
        cls.daemon = cls.enterClassContext(Daemon(
            "builtin:sphere:48", listen=f"0.0.0.0:{PORT}", wrapper=cls.network.server,
            more=["--config", str(config)]))
        cls.local = cls.enterClassContext(cls.daemon.connect())
        cls.env = {**os.environ, "XDG_CONFIG_HOME": str(cls.profiles.parent),
                   "GRPC_VERBOSITY": "NONE"}
        for variable in ("PALPATE_SOCKET", "PALPATE_SERVER", "PALPATE_TLS_CA",
                         "PALPATE_TOKEN_FILE"):
            cls.env.pop(variable, None)

    def there(self, *command, screen=None):
        """On the client's machine, to its end: exit code, stdout, stderr."""
        done = subprocess.run([*self.network.client, *map(str, command)], env=screen or self.env,
                              capture_output=True, text=True, timeout=PATIENCE_S, check=False,
                              cwd=self.folder)
        return done.returncode, done.stdout, done.stderr

    def must(self, *command):
        code, out, err = self.there(*command)
        self.assertEqual(code, 0, err)
        return out

    def open_window(self, *arguments):
        """On the client's machine, in a folder of its own for its pictures."""
        screen = self.enterContext(Screen())
        screen.env["XDG_CONFIG_HOME"] = self.env["XDG_CONFIG_HOME"]
        folder = self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-remote-"))
        window = Window(screen, folder, "--no-overlay", *arguments, there=self.network.client)
        self.addCleanup(window.end)
        return window

    def isovalue_of(self, share):
        info = self.local.volume.info()
        return info.value_min + share * (info.value_max - info.value_min)

    def test_palpate(self):
        info = json.loads(self.must(PALPATE, "--profile", "viewer", "info", "--json"))
        self.assertEqual(info["caller"], {"identity": "token viewer", "role": "viewer"})
        self.assertEqual(info["volume"]["source"], "builtin:sphere:48")
        poses = self.must(PALPATE, "--profile", "viewer", "watch", "--json", "--count", 5)
        self.assertEqual(len(poses.splitlines()), 5)
        self.assertEqual(self.there(PALPATE, "--profile", "viewer", "set", "isovalue", "0.1")[0], 5)
        wanted = self.isovalue_of(0.4)
        self.must(PALPATE, "--profile", "editor", "set", "isovalue", wanted)
        self.assertAlmostEqual(self.local.settings.isovalue, wanted)

    def test_python_and_the_library(self):
        for share, command, says, refuses in (
                (0.45, (sys.executable, "-c", SCRIPT), r"\(48, 48, 48\)", "PermissionDenied"),
                (0.35, (EXAMPLE,), r"tick \d+: tip at", "editor")):
            wanted = self.isovalue_of(share)
            self.assertRegex(self.must(*command, "editor", wanted), says)
            self.assertAlmostEqual(self.local.settings.isovalue, wanted)
            code, _, err = self.there(*command, "viewer", wanted)
            self.assertEqual(code, 1)
            self.assertIn(refuses, err)

    def test_the_window_steers(self):
        window = self.open_window("--profile", "editor")
        window.wait_for_title("Palpate: builtin:sphere:48")
        before = self.local.settings.isovalue
        window.do("mousemove", *HISTOGRAM, "mousedown", 1)
        self.assertTrue(wait_until(lambda: self.local.settings.isovalue != before))
        window.do("mouseup", 1)

    def test_the_window_of_a_viewer_changes_nothing(self):
        window = self.open_window("--profile", "viewer")
        window.wait_for_title("Palpate: builtin:sphere:48")
        refused_before = self.refused_changes()
        self.local.settings.isovalue = before = self.isovalue_of(0.6)
        window.find("needs the role", within=LEFT)
        window.do("mousemove", *HISTOGRAM, "mousedown", 1)
        window.do("mousemove", HISTOGRAM[0] + 60, HISTOGRAM[1])
        window.do("mouseup", 1)
        window.picture()
        # It was not asked for, either.
        self.assertEqual(self.local.settings.isovalue, before)
        self.assertEqual(self.refused_changes(), refused_before)

    def refused_changes(self):
        return sum("RenderService/UpdateSettings" in line for line in self.daemon.said)

    def press(self, window, number):
        """The button of this number in the dialog's first column, from above, once it is there;
        grey ones do not count."""
        rows = []

        def there():
            column = np.asarray(window.picture())[:, DIALOG_X].astype(int)
            of_button = [np.abs(column - color).max(axis=1) < 6 for color in BUTTON]
            at = np.flatnonzero(np.any(of_button, axis=0))
            # One after the other, each some pixels high.
            rows[:] = [group for group in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
                       if len(group) > 10]
            return len(rows) > number

        self.assertTrue(wait_until(there))
        window.click(DIALOG_X + 8, int(rows[number].mean()))

    def test_a_dialog_connects_and_disconnects(self):
        window = self.open_window("--socket", self.folder / "nowhere.sock")
        window.wait_for_title("Palpate: not connected")
        window.do("mousemove", 400, 700, "key", "ctrl+k")
        # The first profile is the editor's; above it is the button that disconnects.
        self.press(window, 1)
        window.wait_for_title("Palpate: builtin:sphere:48")
        self.press(window, 0)
        window.wait_for_title("Palpate: not connected")
        # That one is grey now.
        self.press(window, 0)
        window.wait_for_title("Palpate: builtin:sphere:48")
