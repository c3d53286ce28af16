"""Every call of the contract can be made, with the words of the command line; what takes long
tells its progress and can be cancelled."""

import json
import pathlib
import subprocess
import threading
import time
import unittest

import numpy as np

import palpate
from palpate.v1 import (device_pb2, pose_pb2, recording_pb2, registration_pb2, render_pb2,
                        series_pb2, volume_pb2)
from support import PALPATE, PATIENCE_S, Daemon, DaemonTest, nrrd, pattern


class Contract(unittest.TestCase):
    def test_every_call_is_used(self):
        source = "".join(path.read_text() for path in
                         pathlib.Path(palpate.__file__).parent.glob("*.py"))
        for module in (device_pb2, pose_pb2, recording_pb2, registration_pb2, render_pb2,
                       series_pb2, volume_pb2):
            self.assertTrue(module.DESCRIPTOR.services_by_name, module)
            for service in module.DESCRIPTOR.services_by_name.values():
                for method in service.methods:
                    self.assertRegex(source, rf"stub\.{method.name}\b", method.full_name)


def shown(daemon):
    return json.loads(subprocess.run([PALPATE, "--socket", daemon.socket, "place", "--json"],
                                     check=True, capture_output=True, text=True).stdout)


class Place(DaemonTest):
    def setUp(self):
        self.place = self.conn.volume.place
        self.place(reset=True)

    def test_it_is_where_the_command_line_says(self):
        placed = self.place(center_mm=(1, 2, 3), rotation_wxyz=(0.5, 0.5, 0.5, 0.5),
                            cells_per_mm=2, move_mm=np.array([10, 0, 0]), turn_deg=("y", 90),
                            scale_by=0.5)
        said = shown(self.daemon)
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

    def test_what_is_refused(self):
        before = self.place()
        for change in ({"cells_per_mm": 2, "device_mm_per_voxel": 1}, {"cells_per_mm": 0},
                       {"turn_deg": ("w", 3)}, {"turn_deg": 90}, {"turn_deg": ("x", "90")},
                       {"rotation_wxyz": (1, 0, 0)}, {"rotation_wxyz": (2, 0, 0, 0)},
                       {"center_mm": (1, 2)}, {"move_mm": (float("nan"), 0, 0)},
                       {"scale_by": True}, {"scale_by": 0}, {"device_mm_per_volume_mm": -1},
                       {"reset": "no"}, {"expected_revision": 3}):
            with self.subTest(change), self.assertRaises(palpate.InvalidArgument):
                self.place(**change)
        self.assertEqual(self.place().settings_revision, before.settings_revision)


class Findings(DaemonTest):
    def test_a_value_is_required(self):
        for operation in ("set", "add", "subtract", "paint"):
            with self.assertRaisesRegex(palpate.InvalidArgument, "value is required"):
                self.conn.edit.sphere((24, 24, 24), 5, operation)

    def test_true_is_no_isovalue(self):
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.settings.isovalue = True
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.volume.load("builtin:sphere:32", isovalue=True)
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.series.configure(loop="off")

    def test_a_batch_reads_short(self):
        self.assertLess(len(repr(next(self.conn.poses(1000, 200)))), 100)

    def test_an_upload_says_what_it_assumed(self):
        values = pattern((9, 9, 9))
        values[0, 0, 0] = np.nan
        self.assertRegex(" ".join(self.conn.volume.upload(values).warnings), "not finite")

    def test_who_we_are(self):
        info = self.conn.device.info()
        self.assertEqual((info.caller, info.role), ("local socket", "admin"))

    def test_the_simulated_device_has_no_place_of_rest(self):
        with self.assertRaises(palpate.Error):
            self.conn.device.calibrate()


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
            "series": lambda progress: self.conn.series.load([self.file, self.file],
                                                             progress=progress),
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
        before = self.conn.volume.info().volume_revision
        for name, call in self.calls().items():
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
        cls.file = cls.daemon.folder / "trial.palrec"
        recording = cls.conn.recording
        recording.start(cls.file)
        next(cls.conn.poses(20, 10))
        recording.mark("here")
        next(cls.conn.poses(20, 10))
        cls.ticks = recording.stop().ticks

    def test_it_plays_to_its_end(self):
        told = Told()
        state = self.conn.recording.replay(self.file, 4.0, progress=told)
        self.assertEqual(state, palpate.ReplayState(self.ticks, 0, ""))
        self.assertEqual([told.marker for (told,) in told.told if told.marker], ["here"])

    def test_it_is_cancelled(self):
        for ends, raised in ((False, palpate.Cancelled), (ValueError("mine"), ValueError),
                             (KeyboardInterrupt(), KeyboardInterrupt)):
            with self.assertRaises(raised):
                in_turn(lambda: self.conn.recording.replay(self.file, 0.01,
                                                           progress=Told(ends)))
        # It has ended there too.
        in_turn(self.conn.recording.replay, self.file, 100)

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
            self.conn.recording.replay(self.daemon.folder / "none.palrec")
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.recording.replay(__file__)


if __name__ == "__main__":
    unittest.main()
