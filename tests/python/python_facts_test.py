"""The stream of facts: what a program is told without asking."""

import signal
import unittest

import palpate
from secured import SecuredDaemon
from support import Daemon, DaemonTest, nrrd, pattern


def until(facts, holds):
    """The first of the facts for which this holds. The daemon tells something each second."""
    return next(now for now in facts if holds(now))


class FactsTest(DaemonTest):
    def test_the_first_has_all_of_now(self):
        with self.daemon.connect() as conn:
            facts = next(conn.facts())
            self.assertEqual(facts.settings, conn.settings.all())
            volume = conn.volume.info()
            for name in ("source", "loaded_revision", "shape", "value_max", "unsaved_edits"):
                self.assertEqual(getattr(facts.volume, name), getattr(volume, name), name)
            self.assertIsNone(facts.series)
            self.assertEqual(facts.recording, conn.recording.state())
            device = conn.device.info()
            for name in ("kind", "version", "forces", "caller", "role", "connection"):
                self.assertEqual(getattr(facts.device, name), getattr(device, name), name)
            self.assertEqual([caller.is_you for caller in facts.activity.callers], [True])

    def test_what_others_change_is_told(self):
        path = self.daemon.folder / "facts.mcap"
        frames = [self.daemon.folder / f"facts{n}.nrrd" for n in range(2)]
        for frame in frames:
            frame.write_bytes(nrrd(pattern((12, 12, 12))))
        with self.daemon.connect() as conn, self.daemon.connect() as other:
            facts = conn.facts()
            next(facts)
            other.settings.stiffness_n_per_mm = 0.75
            until(facts, lambda now: now.settings["stiffness_n_per_mm"] == 0.75)
            until(facts, lambda now: "stiffness_n_per_mm" in [
                change.what for change in now.activity.changes])
            other.recording.start(path)
            until(facts, lambda now: now.recording.running)
            other.recording.stop()
            until(facts, lambda now: not now.recording.running)
            other.edit.sphere((24, 24, 24), 3.0, "set", 0.0)
            until(facts, lambda now: now.volume.unsaved_edits == 1)
            other.series.load(frames, discard_edits=True)
            now = until(facts, lambda now: now.series is not None)
            self.assertEqual(now.series.frames, 2)
            other.volume.load("builtin:sphere:48")
            until(facts, lambda now: now.series is None and now.volume.source == "builtin:sphere:48")

    def test_it_ends_with_the_daemon(self):
        with Daemon() as daemon, daemon.connect() as conn:
            facts = conn.facts()
            next(facts)
            daemon.end()
            with self.assertRaises(palpate.Unavailable):
                for _ in facts:
                    pass


class Roles(unittest.TestCase):
    def test_who_gets_another_role_follows_anew(self):
        daemon = self.enterContext(SecuredDaemon())
        conn = self.enterContext(palpate.connect(
            daemon.address, tls_ca=str(daemon.authority.ca),
            token_file=str(daemon.tokens["viewer"])))
        facts = conn.facts()
        self.assertEqual(next(facts).device.role, palpate.Role.VIEWER)
        before = 'name = "viewer"\nrole = "viewer"'
        text = daemon.token_file.read_text()
        self.assertIn(before, text)
        daemon.token_file.write_text(text.replace(before, 'name = "viewer"\nrole = "editor"'))
        daemon.process.send_signal(signal.SIGHUP)
        with self.assertRaises(palpate.Unavailable):
            for _ in facts:
                pass
        self.assertEqual(next(conn.facts()).device.role, palpate.Role.EDITOR)


if __name__ == "__main__":
    unittest.main()
