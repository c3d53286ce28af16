"""Who is connected and who changed what, seen by clients with tokens of their own."""

import contextlib
import json
import os
import subprocess
import unittest

import palpate
from secured import SecuredDaemon
from support import PALPATE, PATIENCE_S, nrrd, pattern, wait_until


class ActivityTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(SecuredDaemon())
        cls.ada = cls.enterClassContext(cls.connect("operator"))
        cls.local = cls.enterClassContext(cls.daemon.connect())

    @classmethod
    def connect(cls, token):
        return palpate.connect(cls.daemon.address, tls_ca=str(cls.daemon.authority.ca),
                               token_file=str(cls.daemon.tokens[token]))

    def who(self, what):
        """Who changed this last, as somebody else sees it."""
        changes = [change for change in self.local.activity().changes if change.what == what]
        self.assertLessEqual(len(changes), 1)
        if not changes:
            return None
        self.assertGreaterEqual(changes[0].ago_s, 0.0)
        return changes[0].by.split(" at ")[0]

    def test_each_caller_has_identity_role_and_place(self):
        def callers():
            return {caller.identity: caller for caller in self.local.activity().callers}

        # Here as long as a call runs, however slow this machine is.
        next(self.enterContext(self.ada.poses()))
        seen = callers()
        self.assertEqual(seen["token operator"].role, palpate.Role.OPERATOR)
        self.assertEqual(seen["token operator"].peer, "ipv4:127.0.0.1")
        self.assertFalse(seen["token operator"].is_you)
        self.assertTrue(seen["local socket"].is_you)
        self.assertEqual(seen["local socket"].peer, "")
        mine = [caller.identity for caller in self.ada.activity().callers if caller.is_you]
        self.assertEqual(mine, ["token operator"])
        # A viewer watches, until it goes.
        self.assertTrue(wait_until(lambda: "token viewer" not in callers()))
        with self.connect("viewer") as viewer:
            with viewer.poses() as stream:
                next(stream)
                self.assertTrue(callers()["token viewer"].watches)
            self.assertTrue(wait_until(lambda: not callers()["token viewer"].watches))
        self.assertTrue(wait_until(lambda: "token viewer" not in callers()))

    def test_what_was_changed_by_whom(self):
        sphere = ((24, 24, 24), 3.0, "subtract", 0.3)
        frames = [self.daemon.folder / f"who{n}.nrrd" for n in range(2)]
        for n, frame in enumerate(frames):
            frame.write_bytes(nrrd(pattern((12, 10, 9)) + 1000.0 * n))
        for what, change in (
                ("isovalue", lambda conn: conn.settings.update(isovalue=0.4)),
                ("isovalue", lambda conn: conn.settings.update(normalized_isovalue=0.6)),
                ("stiffness_n_per_mm", lambda conn: conn.settings.update(stiffness_n_per_mm=0.7)),
                ("placement", lambda conn: conn.volume.place(move_mm=(1, 0, 0))),
                ("voxels", lambda conn: conn.edit.sphere(*sphere)),
                ("voxels", lambda conn: conn.edit.undo()),
                ("voxels", lambda conn: conn.edit.filter("gaussian")),
                ("forces", lambda conn: conn.device.disable()),
                ("forces", lambda conn: conn.device.stop()),
                ("forces", lambda conn: conn.device.enable()),
                ("volume", lambda conn: conn.volume.load("builtin:sphere:32",
                                                         discard_edits=True)),
                ("volume", lambda conn: conn.series.load([str(frame) for frame in frames])),
                ("series", lambda conn: conn.series.seek(1.0)),
                ("volume", lambda conn: conn.volume.upload(pattern((12, 10, 9))))):
            with self.subTest(what):
                change(self.local)
                self.assertEqual(self.who(what), "local socket")
                change(self.ada)
                self.assertEqual(self.who(what), "token operator")
                self.assertEqual(self.local.activity().changes[0].what, what)

    def test_a_recording_is_started_by_one_and_stopped_by_another(self):
        self.ada.recording.start(str(self.daemon.folder / "who.mcap"), overwrite=True)
        self.assertEqual(self.who("recording"), "token operator")
        self.local.recording.stop()
        self.assertEqual(self.who("recording"), "local socket")

    def test_what_fails_or_only_looks_is_no_change(self):
        before = [(change.what, change.by) for change in self.local.activity().changes]
        for fails in (lambda: self.ada.settings.update(damping_n_s_per_m=-1),
                      lambda: self.ada.volume.load("/absent.nrrd"),
                      lambda: self.ada.device.enable("another")):
            with self.assertRaises(palpate.Error):
                fails()
        with self.connect("viewer") as viewer, contextlib.suppress(palpate.Error):
            viewer.settings.damping_n_s_per_m = 1.0
        self.ada.volume.info()
        self.assertEqual([(change.what, change.by) for change in self.local.activity().changes],
                         before)

    def test_the_command_line_shows_it(self):
        self.ada.settings.stiffness_n_per_mm = 0.6
        next(self.enterContext(self.ada.poses()))

        def run(*arguments):
            return subprocess.run([PALPATE, "who", *arguments], capture_output=True, text=True,
                                  timeout=PATIENCE_S, check=True,
                                  env={**os.environ, "PALPATE_SOCKET": self.daemon.socket}).stdout

        said = run()
        for text in ("token operator at ", "local socket (you)", "watches", "stiffness_n_per_mm"):
            self.assertIn(text, said)
        seen = json.loads(run("--json"))
        self.assertEqual(seen["changes"][0]["what"], "stiffness_n_per_mm")
        self.assertIn({"token operator": "operator"},
                      [{caller["identity"]: caller["role"]} for caller in seen["callers"]])


if __name__ == "__main__":
    unittest.main()
