"""Recordings of a real daemon, as scripts make them and palpate-lab computes them again."""

import json
import os
import re
import signal
import subprocess
import unittest

import numpy as np

import palpate
from support import PALPATE, PATIENCE_S, Daemon, nrrd, wait_until

PALPATE_LAB = os.environ["PALPATE_LAB"]
CONFLICT, NOT_FOUND, CANCELLED, USAGE = 7, 4, 9, 2


class RecordingTest(unittest.TestCase):
    def setUp(self):
        self.daemon = self.enterContext(Daemon("builtin:gyroid:64"))
        self.conn = self.enterContext(self.daemon.connect())
        self.file = self.daemon.folder / "a.mcap"

    def palpate(self, *arguments, code=0):
        ran = subprocess.run([PALPATE, *map(str, arguments), "--socket", self.daemon.socket],
                             capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        self.assertEqual(ran.returncode, code, ran.stderr)
        return ran

    def begun(self, *arguments):
        """A client that runs on."""
        client = self.enterContext(subprocess.Popen(
            [PALPATE, *map(str, arguments), "--socket", self.daemon.socket],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))
        self.addCleanup(client.kill)
        return client

    def replayed(self, *more, code=0):
        """What palpate-lab says of the recording: its figures by name, and its complaints."""
        ran = subprocess.run([PALPATE_LAB, "replay", "--recording", self.file, *more],
                             capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        self.assertEqual(ran.returncode, code, ran.stdout + ran.stderr)
        figures = {name: int(number) for name, number
                   in re.findall(r"^ *([a-z]+) +(\d+)", ran.stdout, re.MULTILINE)}
        if code == 0:
            self.assertEqual(figures["differing"], 0)
        return figures, ran.stderr

    def wait_for_ticks(self, more):
        end = self.conn.recording.state().ticks + more
        self.assertTrue(wait_until(lambda: self.conn.recording.state().ticks >= end, PATIENCE_S))

    def test_it_comes_back_bit_for_bit_from_the_recording_alone(self):
        i, j, k = np.indices((30, 28, 26))
        away = np.sqrt((i - 14.5)**2 + (j - 13.5)**2 + (k - 12.5)**2)
        files = [self.daemon.folder / f"t{n}.nrrd" for n in range(4)]
        for n, path in enumerate(files):
            path.write_bytes(nrrd((away + n * np.sin(0.5 * i)).astype(np.float32)))
        self.palpate("record", "start", self.file)
        for n in range(10):
            self.conn.settings.update(normalized_isovalue=0.4 + 0.02 * n,
                                      passivity_control=n % 2 == 1)
            self.wait_for_ticks(100)
        self.conn.recording.mark('half, "way"')
        self.palpate("load", "builtin:bumps:48", "--spacing-mm", "1,1,0.5")
        self.wait_for_ticks(300)
        self.conn.series.load(files, normalized_isovalue=0.4)
        self.conn.series.configure(interpolate=True, loop=True)
        self.conn.series.play(7)
        self.wait_for_ticks(700)
        self.conn.volume.upload((away + 0.5 * np.sin(0.5 * i)).astype(np.float32),
                                normalized_isovalue=0.4)
        self.wait_for_ticks(200)
        self.conn.edit.sphere((14, 14, 3), 4, "set", 20.0)
        self.wait_for_ticks(200)
        state = json.loads(self.palpate("record", "stop", "--json").stdout)
        self.assertEqual((state["lost_ticks"], state["left_out"]), (0, ""))
        self.assertEqual(state["size_bytes"], self.file.stat().st_size)
        # The files are gone: the recording has their voxels.
        for path in files:
            path.unlink()
        figures, _ = self.replayed()
        self.assertEqual((figures["ticks"], figures["markers"]), (state["ticks"], 1))
        self.assertGreaterEqual(figures["compared"] + 70, state["ticks"])
        self.assertGreaterEqual(figures["scenes"], 12)
        recording = palpate.open_recording(self.file)
        self.assertTrue(recording.complete, recording.ends_early)
        positions = recording.ticks.series_position_frames
        for scene in recording.scenes:
            felt = positions[recording.ticks.scene_revision == scene.scene_revision]
            expected = scene.series_position_frames
            np.testing.assert_array_equal(felt, np.nan if expected is None else expected)
        self.assertGreater(np.nanmax(positions), 1.0)
        self.assertTrue(np.isnan(positions[-1]))

    def test_resampled_volumes_come_back(self):
        self.palpate("record", "start", self.file)
        for spacing_mm in (0.7, 1.1, 0.9):
            self.conn.edit.filter("resample", spacing_mm=spacing_mm)
            self.conn.edit.sphere((0, 0, 0), 5.0, "set", 0.5)
            self.conn.edit.undo()
        self.conn.edit.undo()
        self.palpate("record", "stop")
        self.replayed()

    def test_what_cannot_be_computed_again_is_said(self):
        # A load of a file is named and not held: where the file is gone, that is an error.
        path = self.daemon.folder / "a.nrrd"
        i, j, k = np.indices((20, 20, 20))
        path.write_bytes(nrrd((i * j + k).astype(np.float32)))
        self.conn.recording.start(self.file)
        self.wait_for_ticks(500)
        self.conn.volume.load(path)
        self.wait_for_ticks(200)
        self.conn.recording.stop()
        self.replayed()
        self.replayed("--volume", "builtin:bumps", code=CONFLICT)
        self.replayed("--isovalue", "1", code=USAGE)
        path.unlink()
        self.assertIn("--allow-missing", self.replayed(code=CONFLICT)[1])
        self.assertGreater(self.replayed("--allow-missing")[0]["compared"], 300)
        # More than 64 MiB of voxels that no file gives again.
        large = self.daemon.folder / "large.dat"
        np.repeat(np.arange(264) // 3, 264**2).astype(np.uint8).tofile(large)
        self.conn.volume.upload_file(large, raw=palpate.Raw((264,) * 3, "uint8"))
        self.assertIn("upload:large.dat",
                      self.palpate("record", "start", self.file, "--overwrite").stderr)
        self.wait_for_ticks(300)
        self.assertNotEqual(self.conn.recording.stop().left_out, "")
        self.assertIn("--volume", self.replayed(code=NOT_FOUND)[1])

    def test_a_replay_begins_in_the_middle_with_all_that_came_before(self):
        self.assertEqual(self.conn.recording.list(), ())
        self.conn.recording.start(self.file)
        for n in range(4):
            self.conn.edit.sphere((4.0 * n, 0.0, 0.0), 6.0, "set", 0.3 + 0.1 * n)
            self.wait_for_ticks(150)
            self.conn.recording.mark(f"edit {n}")
            self.wait_for_ticks(150)
        state = self.conn.recording.stop()
        self.conn.edit.revert()
        # What playing from the start has come to.
        recorded = palpate.open_recording(self.file)
        loaded = self.conn.volume.download().values
        listed, = self.conn.recording.list()
        self.assertEqual((listed.path, listed.size_bytes), (str(self.file), state.size_bytes))

        seen = []

        def look(now):
            # A tick of the servo shows the first one.
            if now.ticks == first:
                return True
            if not seen:
                with self.conn.poses() as poses:
                    pose = next(iter(poses))
                seen.append((now, pose, self.conn.volume.download().values))
            return False
        for first in (0, 200, 500, 1000):
            with self.subTest(first=first):
                seen.clear()
                with self.assertRaises(palpate.Cancelled):
                    self.conn.recording.replay(self.file, 1e-6, first_tick=first, progress=look)
                (now, pose, values), = seen
                self.assertEqual(now.total_ticks, state.ticks)
                self.assertEqual([text for _, text in now.markers],
                                 [f"edit {n}" for n in range(4)])
                for field in ("hip_mm", "scp_h_mm", "force_n"):
                    np.testing.assert_array_equal(getattr(pose, field).reshape(3),
                                                  getattr(recorded.ticks, field)[first])
                np.testing.assert_array_equal(
                    values, recorded.voxels(recorded.ticks.tick[first], loaded))
        np.testing.assert_array_equal(self.conn.volume.download().values, loaded)
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.recording.replay(self.file, first_tick=state.ticks)
        self.assertIn("a.mcap", self.palpate("record", "list").stdout)
        self.palpate("replay", self.file, "--from", "1", "--speed", "20")

    def test_another_programs_replay_is_told_to_all_who_watch(self):
        self.conn.recording.start(self.file)
        self.wait_for_ticks(500)
        self.conn.recording.stop()
        hips = palpate.open_recording(self.file).ticks.hip_mm
        before = self.enterContext(self.conn.poses())
        next(before)
        self.assertEqual(before.shows, "live")
        self.assertIsNone(self.conn.recording.state().replay)

        # So slow that it lasts until it is ended.
        client = self.begun("replay", self.file, "--speed", "0.001")
        self.assertTrue(wait_until(lambda: next(before).replayed[-1], PATIENCE_S))
        with self.daemon.connect() as late, late.poses() as stream:
            poses = next(stream)
            self.assertTrue(poses.replayed.all())
            self.assertEqual(stream.shows, "replay")
        self.assertTrue((hips == poses.hip_mm).all(axis=1).any())
        self.assertEqual((poses.force_state[-1], poses.force_reason[-1]),
                         (palpate.ForceState.HELD, palpate.ForceReason.REPLAY))
        forces = self.conn.device.info().forces
        self.assertEqual((forces.state, forces.reason), ("held", "replay"))
        replay = self.conn.recording.state().replay
        self.assertEqual((replay.by, replay.path, replay.total_ticks, replay.speed),
                         ("local socket", str(self.file), len(hips), 0.001))
        self.assertIn("replay of a.mcap by local socket: forces are off",
                      self.palpate("info").stdout)
        self.assertIn("replay: forces are off", self.palpate("watch", "--seconds", "2").stdout)

        # A stop in a replay outlasts it. Forces that are enabled in it come at its end.
        self.assertEqual(self.conn.device.stop().state, "stopped")
        self.assertTrue(wait_until(lambda: next(before).force_state[-1] == 6, PATIENCE_S))
        self.assertEqual(self.conn.device.enable().reason, "replay")
        client.send_signal(signal.SIGINT)
        client.wait(PATIENCE_S)
        self.assertTrue(wait_until(lambda: not next(before).replayed[-1], PATIENCE_S))
        self.assertEqual(before.shows, "live")
        self.assertTrue(wait_until(lambda: self.conn.device.info().forces.state == "on",
                                   PATIENCE_S))
        self.assertIsNone(self.conn.recording.state().replay)
        self.daemon.end()
        self.assertTrue(wait_until(lambda: before.shows == "old", PATIENCE_S))

    def test_the_client_records_and_replays_until_it_is_interrupted(self):
        self.palpate("record", "run", self.file, "--seconds", "0.5")
        client = self.begun("record", "run", self.daemon.folder / "b.mcap")
        self.assertTrue(wait_until(lambda: self.conn.recording.state().running, PATIENCE_S))
        self.palpate("replay", self.file, code=CONFLICT)
        client.send_signal(signal.SIGINT)
        self.assertEqual(client.wait(PATIENCE_S), 0)
        self.assertFalse(self.conn.recording.state().running)

        self.conn.recording.start(self.file, overwrite=True)
        self.conn.recording.mark("begun")
        self.wait_for_ticks(1000)
        self.conn.recording.stop()

        def replay_slowly():
            client = self.begun("replay", self.file, "--speed", "0.1")
            self.assertTrue(any("begun" in line for line in client.stdout))
            return client
        client = replay_slowly()
        with self.assertRaises(palpate.Conflict):
            self.conn.recording.start(self.daemon.folder / "c.mcap")
        client.send_signal(signal.SIGINT)
        self.assertEqual(client.wait(PATIENCE_S), CANCELLED)
        # The daemon ends though one runs.
        client = replay_slowly()
        self.daemon.end()
        self.assertNotEqual(client.wait(PATIENCE_S), 0)


if __name__ == "__main__":
    unittest.main()
