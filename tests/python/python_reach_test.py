"""Every call of the contract can be made, with the words of the command line; what takes long
tells its progress and can be cancelled."""

import json
import threading
import time
import unittest

import numpy as np

import palpate
from support import PATIENCE_S, Daemon, DaemonTest, nrrd, pattern, wait_until


class Place(DaemonTest):
    def setUp(self):
        self.place = self.conn.volume.place
        self.place(reset=True)

    def test_it_is_where_the_command_line_says(self):
        placed = self.place(center_mm=(1, 2, 3), rotation_wxyz=(0.5, 0.5, 0.5, 0.5),
                            cells_per_mm=2, move_mm=np.array([10, 0, 0]), turn_deg=("y", 90),
                            scale_by=0.5)
        said = json.loads(self.daemon.palpate("place", "--json").stdout)
        np.testing.assert_allclose(placed.center_mm, (11, 2, 3), atol=1e-12)
        self.assertEqual(placed.center_mm.tolist(), said["center_mm"])
        self.assertEqual(placed.rotation_wxyz.tolist(), said["rotation_wxyz"])
        self.assertAlmostEqual(placed.device_mm_per_voxel, 0.25)
        self.assertEqual(placed.device_mm_per_voxel, said["device_mm_per_voxel"])
        self.assertEqual(placed.settings_revision, said["settings_revision"])
        asked = self.place()
        self.assertIsNone(asked.applied_tick)
        np.testing.assert_array_equal(asked.center_mm, placed.center_mm)
        info = self.conn.volume.info()
        center = info.device_from_index @ (*((n - 1) / 2 for n in info.shape), 1)
        np.testing.assert_allclose(center[:3], placed.center_mm, atol=1e-9)

    def test_a_turn_and_its_tick(self):
        before = self.place()
        placed = self.place(turn_deg=("z", 90), expected_revision=before.settings_revision)
        self.assertGreater(placed.applied_tick, 0)
        self.assertEqual(placed.settings_revision, before.settings_revision + 1)
        with self.assertRaises(palpate.Conflict):
            self.place(scale_by=2, expected_revision=before.settings_revision)
        np.testing.assert_allclose(
            self.place(turn_deg=("z", -90)).rotation_wxyz, before.rotation_wxyz, atol=1e-12)

    def test_an_answer_to_where_the_patient_faces_is_kept_for_the_voxels(self):
        values = pattern((9, 8, 7))
        info = self.conn.volume.upload(values, name="first")
        self.assertEqual((info.patient_axes, info.patient_axes_answered), ("", False))
        self.place(face="+y", head="+z")
        info = self.conn.volume.info()
        self.assertEqual((info.patient_axes, info.patient_axes_answered), ("RAS", True))
        self.assertEqual(self.conn.volume.upload(values, name="second").patient_axes, "RAS")
        self.assertEqual(self.conn.volume.upload(values + 1, name="second").patient_axes, "")

    def test_what_is_refused(self):
        before = self.place()
        for change in ({"cells_per_mm": 2, "device_mm_per_voxel": 1}, {"cells_per_mm": 0},
                       {"turn_deg": ("w", 3)}, {"turn_deg": 90}, {"turn_deg": ("x", "90")},
                       {"rotation_wxyz": (1, 0, 0)}, {"rotation_wxyz": (2, 0, 0, 0)},
                       {"center_mm": (1, 2)}, {"move_mm": (float("nan"), 0, 0)},
                       {"scale_by": True}, {"scale_by": 0}, {"device_mm_per_volume_mm": -1},
                       {"reset": "no"}, {"expected_revision": 3}, {"face": "-y"},
                       {"face": "y", "head": "+z"}, {"face": "-y", "head": "+y"}):
            with self.subTest(change), self.assertRaises(palpate.InvalidArgument):
                self.place(**change)
        self.assertEqual(self.place().settings_revision, before.settings_revision)


class Told:
    """A progress that keeps what it is told, and may end the call at the first."""

    def __init__(self, ends=None):
        self.told = []
        self._ends = ends

    def __call__(self, *told):
        self.told.append(told)
        if isinstance(self._ends, BaseException):
            raise self._ends
        return self._ends


def in_turn(call, *arguments):
    """Calls it again while the daemon still ends what was cancelled before."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            return call(*arguments)
        except palpate.Conflict:
            if time.monotonic() > end:
                raise
            time.sleep(0.02)


class Progress(DaemonTest):
    def setUp(self):
        self.values = np.random.default_rng(7).uniform(0, 1, (96, 96, 96)).astype(np.float32)
        self.file = self.daemon.folder / "noise.nrrd"
        if not self.file.exists():
            self.file.write_bytes(nrrd(self.values, np.eye(3).tolist(), [0.0, 0.0, 0.0]))

    def calls(self):
        volume = self.conn.volume
        return {
            "load": lambda progress: volume.load(self.file, progress=progress),
            "upload": lambda progress: volume.upload(self.values, progress=progress),
            "upload_file": lambda progress: volume.upload_file(self.file, progress=progress),
            "download": lambda progress: volume.download(progress=progress),
            "save": lambda progress: volume.save(self.daemon.folder / "out.nrrd", overwrite=True,
                                                 progress=progress),
            "filter": lambda progress: self.conn.edit.filter("median", 2, progress=progress),
            "series": lambda progress: self.conn.series.load(
                [self.file, self.file], discard_edits=True, progress=progress),
        }

    def test_shares_rise(self):
        self.conn.volume.load(self.file)
        for name, call in self.calls().items():
            with self.subTest(name):
                told = Told()
                call(told)
                shares = [share for _, share in told.told]
                self.assertEqual(shares, sorted(shares))
                self.assertTrue(shares and 0 <= shares[0] and shares[-1] <= 1, shares)
                self.assertTrue(all(stage.strip() for stage, _ in told.told), told.told)

    def test_each_can_be_cancelled_and_changes_nothing(self):
        self.conn.volume.load(self.file)
        recording, trial = self.conn.recording, self.daemon.folder / "trial.mcap"
        recording.start(trial)
        next(self.conn.poses(20, 10))
        recording.stop()
        calls = self.calls() | {
            "replay": lambda progress: recording.replay(trial, 0.01, progress=progress)}
        before = self.conn.volume.info().volume_revision
        for name, call in calls.items():
            for ends, raised in ((False, palpate.Cancelled), (ValueError("mine"), ValueError),
                                 (KeyboardInterrupt(), KeyboardInterrupt)):
                with self.subTest(name, ends=ends):
                    told = Told(ends)
                    with self.assertRaises(raised) as caught:
                        in_turn(call, told)
                    if ends is not False:
                        self.assertIs(caught.exception, ends)
                    self.assertEqual(len(told.told), 1)
        self.assertEqual(self.conn.volume.info().volume_revision, before)
        # None of them left anything running.
        in_turn(recording.replay, trial, 100)
        in_turn(self.conn.volume.load, "builtin:sphere:32")

    def test_a_refused_upload_with_progress(self):
        broken = self.daemon.folder / "broken.nrrd"
        broken.write_bytes(self.file.read_bytes()[:5000])
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.volume.upload_file(broken, progress=Told())
        with self.assertRaises(palpate.NotFound):
            self.conn.volume.upload_file(self.daemon.folder / "none.nrrd")
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.volume.upload_file(self.daemon.folder)


class Raw(DaemonTest):
    def setUp(self):
        self.values = pattern((5, 6, 7), ">i4")
        self.file = self.daemon.folder / "voxels.raw"
        self.file.write_bytes(b"12" + self.values.tobytes(order="F"))
        self.raw = palpate.Raw((5, 6, 7), "int32", big_endian=True, offset_bytes=2)

    def test_each_way_in(self):
        volume = self.conn.volume
        ways = {"load": lambda: volume.load(self.file, raw=self.raw, spacing_mm=(1, 2, 3)),
                "upload": lambda: volume.upload_file(self.file, raw=self.raw,
                                                     spacing_mm=(1, 2, 3)),
                "series": lambda: self.conn.series.load([self.file] * 2, raw=self.raw,
                                                        spacing_mm=(1, 2, 3))}
        for name, way in ways.items():
            with self.subTest(name):
                volume.load("builtin:sphere:32")
                way()
                copy = volume.download()
                np.testing.assert_array_equal(copy.values, self.values)
                self.assertEqual(copy.spacing_mm.tolist(), [1, 2, 3])

    def test_what_is_refused(self):
        for raw in (palpate.Raw((5, 6, 7), "i4"), palpate.Raw((5, 6), "int32"),
                    palpate.Raw((5, 6, -7), "int32"), palpate.Raw((5, 6, "7"), "int32"),
                    palpate.Raw((5, 6, 7), "int32", "yes"),
                    palpate.Raw((5, 6, 7), "int32", False, -1)):
            with self.subTest(raw), self.assertRaises(palpate.InvalidArgument):
                self.conn.volume.load(self.file, raw=raw)


class Replay(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(Daemon())
        cls.conn = cls.enterClassContext(cls.daemon.connect())
        cls.file = cls.daemon.folder / "trial.mcap"
        recording = cls.conn.recording
        recording.start(cls.file)
        next(cls.conn.poses(20, 10))
        recording.mark("here")
        next(cls.conn.poses(20, 10))
        cls.state = recording.stop()

    def test_it_plays_to_its_end(self):
        self.assertEqual((self.state.running, self.state.error), (False, ""))
        self.assertEqual((self.state.path, self.state.size_bytes),
                         (str(self.file), self.file.stat().st_size))
        told = Told()
        state = self.conn.recording.replay(self.file, 4.0, progress=told)
        self.assertEqual((state.ticks, state.lost_ticks, state.marker),
                         (self.state.ticks, self.state.lost_ticks, ""))
        self.assertEqual([told.marker for (told,) in told.told if told.marker], ["here"])

    def test_a_second_one_has_to_wait(self):
        begun, refused = threading.Event(), []

        def progress(_):
            if not begun.is_set():
                begun.set()
                try:
                    self.conn.recording.replay(self.file)
                except palpate.Conflict as conflict:
                    refused.append(conflict)
        self.conn.recording.replay(self.file, progress=progress)
        self.assertEqual(len(refused), 1)

    def test_what_is_refused(self):
        for speed in (0, -1, 101, float("nan"), "2", True):
            with self.subTest(speed), self.assertRaises(palpate.InvalidArgument):
                self.conn.recording.replay(self.file, speed)
        with self.assertRaises(palpate.NotFound):
            self.conn.recording.replay(self.daemon.folder / "none.mcap")
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.recording.replay(__file__)
        with self.assertRaises(palpate.Conflict):
            self.conn.recording.start(self.file)
        with self.assertRaises(palpate.Conflict):
            self.conn.recording.mark("too early")
        for text in ("", "x" * 4097, "é" * 2049, "\ud800", 5, None):
            with self.subTest(text), self.assertRaises(palpate.InvalidArgument):
                self.conn.recording.mark(text)


class Forces(DaemonTest):
    def test_device_is_told_and_stopped(self):
        info = self.conn.device.info()
        self.assertEqual((info.kind, info.rate_hz), ("simulated", 1000.0))
        self.assertIs(info.verification_level, palpate.VerificationLevel.SIMULATED)
        self.assertTrue(wait_until(
            lambda: self.conn.device.info().forces.state is palpate.ForceState.ON, PATIENCE_S))
        stopped = self.conn.device.stop()
        self.assertIs(stopped.state, palpate.ForceState.STOPPED)
        self.assertIs(stopped.reason, palpate.ForceReason.STOP_CALL)
        self.assertEqual(self.conn.device.info().forces_set_by, "local socket")
        with self.conn.poses(1000, 20) as stream:
            poses = next(stream)
        self.assertTrue((poses.force_state == palpate.ForceState.STOPPED).all())
        self.assertTrue((poses.force_n == 0).all())
        self.conn.device.enable()
        self.assertTrue(wait_until(
            lambda: self.conn.device.info().forces.state is palpate.ForceState.ON, PATIENCE_S))
        self.assertIs(self.conn.device.disable().reason, palpate.ForceReason.OPERATOR)
        self.conn.device.enable("simulated")

    def test_which_devices_there_are(self):
        listed = self.conn.device.list()
        self.assertEqual([device.kind for device in listed if device.in_use], ["simulated"])
        info = self.conn.device.info()
        self.assertEqual((info.caller, info.role), ("local socket", "admin"))
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.device.enable("falcon")
        # It has no place of rest.
        with self.assertRaises(palpate.Error):
            self.conn.device.calibrate()


class Series(DaemonTest):
    def test_series(self):
        with self.assertRaises(palpate.Conflict):
            self.conn.series.state()
        frames = [pattern((12, 10, 9)) + 1000.0 * n for n in range(3)]
        for n, frame in enumerate(frames):
            path = self.daemon.folder / f"frame{n}.nrrd"
            path.write_bytes(nrrd(frame, np.eye(3).tolist(), (0.0, 0.0, 0.0)))
        state = self.conn.series.load(self.daemon.folder / "frame*.nrrd")
        self.assertEqual((state.frames, state.playing, state.position_frames), (3, False, 0.0))
        for n in (2, 0, 1):
            self.conn.series.seek(n)
            self.assertTrue(wait_until(lambda: np.array_equal(
                self.conn.volume.download().values, frames[n]), PATIENCE_S))
        self.conn.series.configure(loop=True, interpolate=False)
        state = self.conn.series.play(rate_hz=-20)
        self.assertEqual((state.playing, state.rate_hz, state.loop), (True, -20.0, True))
        self.assertEqual(self.conn.series.rate_hz, -20.0)
        self.assertFalse(self.conn.series.pause().playing)
        # Set while it is paused: it stays so.
        self.conn.series.rate_hz = 12.5
        state = self.conn.series.state()
        self.assertEqual((state.playing, state.rate_hz), (False, 12.5))
        self.assertEqual(self.conn.series.play().rate_hz, 12.5)
        for call in (lambda: self.conn.series.seek(99), lambda: self.conn.series.seek(True),
                     lambda: self.conn.series.play(rate_hz="fast"),
                     lambda: self.conn.series.configure(loop="off"),
                     lambda: setattr(self.conn.series, "rate_hz", 0.0),
                     lambda: setattr(self.conn.series, "rate_hz", 1001.0),
                     lambda: setattr(self.conn.series, "rate_hz", True)):
            with self.assertRaises(palpate.InvalidArgument):
                call()
        self.assertEqual(self.conn.series.rate_hz, 12.5)


if __name__ == "__main__":
    unittest.main()
