"""Recordings are read as they were written: ticks, markers, settings and voxels; and of damaged
ones what is whole."""

import dataclasses
import os
import pathlib
import random
import shutil
import struct
import sys
import tempfile
import time
import unittest

import numpy as np
import xxhash
import zstandard

import palpate
from support import Daemon

sys.path.append(str(pathlib.Path(__file__).parents[1] / "fuzz"))
import corpus_recordings  # noqa: E402


def record(daemon, conn, path):
    """A recording with all that one can hold; what is expected of it."""
    expected = {"settings": [], "voxels": []}

    def now():
        expected["settings"].append((conn.settings.all(), next(conn.poses(500)).tick[-1]))
        volume = conn.volume.download()
        expected["voxels"].append((next(conn.poses(500)).tick[-1], volume.values))

    conn.volume.load("builtin:sphere:48", discard_edits=True)
    expected["loaded"] = [conn.volume.download().values]
    expected["before_ns"] = time.monotonic_ns()
    conn.recording.start(path)
    expected["after_ns"] = time.monotonic_ns()
    now()
    conn.settings.update(stiffness_n_per_mm=0.7, static_friction=0.3, force_shading=True,
                         method="bcc", free_side="above")
    expected["marker"] = ('a "quoted", marker\nof two lines: µ', conn.recording.mark(
        'a "quoted", marker\nof two lines: µ'))
    now()
    for n in range(4):
        conn.edit.sphere((10 * n, 20, 24), 7, "add", 0.3, frame="index", falloff=2)
        now()
    conn.edit.undo()
    now()
    # A volume that no file gives again: its voxels are stored.
    values = np.random.default_rng(1).uniform(-3, 5, (20, 33, 18)).astype(np.float32)
    conn.volume.upload(values, (0.5, 1, 2), name="mine", unit="HU", discard_edits=True)
    expected["volume"] = conn.volume.download()
    expected["loaded"].append(values)
    now()
    conn.edit.box((3, 3, 3), (12, 12, 12), "set", 1.5, frame="index")
    conn.settings.isovalue = 0.25
    now()
    for _ in range(3):
        expected["poses"] = next(conn.poses(1000, 256))
    expected["state"] = conn.recording.stop()
    return expected


class RecordingTest(unittest.TestCase):
    """One recording for all tests of this file."""

    expected = None

    @classmethod
    def setUpClass(cls):
        if RecordingTest.expected is None:
            RecordingTest.folder = pathlib.Path(
                unittest.enterModuleContext(tempfile.TemporaryDirectory()))
            RecordingTest.path = RecordingTest.folder / "trial.palrec"
            with Daemon() as daemon, daemon.connect() as conn:
                RecordingTest.expected = record(daemon, conn, daemon.folder / "trial.palrec")
                shutil.copy(daemon.folder / "trial.palrec", RecordingTest.path)
            RecordingTest.recording = palpate.open_recording(RecordingTest.path)


class Recorded(RecordingTest):
    def test_it_is_whole(self):
        recording, state = self.recording, self.expected["state"]
        self.assertTrue(recording.complete, recording.ends_early)
        self.assertEqual((len(recording.ticks), recording.lost_ticks),
                         (state.ticks, state.lost_ticks))
        self.assertTrue(recording.program.startswith("palpated "), recording.program)
        self.assertGreater(recording.created_unix_ns, 1_600_000_000 * 10**9)
        began_ns = recording.created_monotonic_ns
        self.assertTrue(self.expected["before_ns"] <= began_ns <= self.expected["after_ns"])
        self.assertEqual(recording.to_unix_ns([began_ns, began_ns + 5]).tolist(),
                         [recording.created_unix_ns, recording.created_unix_ns + 5])
        self.assertIn(f"{state.ticks} ticks", repr(recording))

    def test_names_and_values_are_those_of_poses(self):
        for name, array in vars(self.recording.ticks).items():
            self.assertEqual(len(array), len(self.recording.ticks), name)
        of_poses, of_ticks = ({field.name: field.type for field in dataclasses.fields(kind)}
                              for kind in (palpate.Poses, palpate.RecordedTicks))
        shared = set(of_poses) - {"replayed", "sent_time_ns", "dropped_samples"}
        self.assertLessEqual(shared, set(of_ticks))
        for name in shared:
            self.assertEqual(of_poses[name], of_ticks[name], name)
        # python_tables_test compares all that is recorded.
        ticks, poses = self.recording.ticks, self.expected["poses"]
        _, at, streamed = np.intersect1d(ticks.tick, poses.tick, return_indices=True)
        self.assertGreater(len(at), 0)
        for name in shared:
            np.testing.assert_array_equal(getattr(ticks, name)[at],
                                          getattr(poses, name)[streamed], name)

    def test_markers(self):
        text, time_ns = self.expected["marker"]
        marker, = self.recording.markers
        self.assertEqual((marker.text, marker.time_ns), (text, time_ns))
        self.assertEqual(marker.tick, self.recording.ticks.tick[
            [begun <= time_ns for begun in self.recording.ticks.time_ns].index(False) - 1])
        self.assertLessEqual(marker.tick, self.expected["settings"][1][1])

    def test_settings_of_each_state(self):
        for settings, tick in self.expected["settings"]:
            scene = self.recording.scene_at(tick)
            self.assertEqual(scene.settings, settings)
            self.assertEqual(scene.unknown_settings, {})
        self.assertEqual(self.recording.volume_sources, ("builtin:sphere:48", "upload:mine.nrrd"))
        with self.assertRaises(palpate.NotFound):
            self.recording.scene_at(0)

    def test_places_in_the_world(self):
        scene = self.recording.scenes[-1]
        uploaded = self.expected["volume"]
        np.testing.assert_array_equal(scene.world_from_index, uploaded.world_from_index)
        indices = np.array([[0, 0, 0], [3, 4, 5], [19, 32, 17]], float)
        there = [matrix[:3, :3] @ indices.T + matrix[:3, 3:]
                 for matrix in (scene.device_from_index, scene.world_from_index)]
        np.testing.assert_allclose(scene.to_world_mm(there[0].T), there[1].T, atol=1e-9)
        np.testing.assert_allclose(scene.to_world_mm(there[0].T[1]), there[1].T[1], atol=1e-9)
        for bad in ((1, 2), np.zeros((2, 2, 3)), 5, "abc"):
            with self.assertRaises(palpate.InvalidArgument):
                scene.to_world_mm(bad)

    def test_voxels_of_each_state(self):
        changed = set()
        for tick, values in self.expected["voxels"]:
            scene = self.recording.scene_at(tick)
            loaded = None if scene.all_voxels_stored else self.expected["loaded"][0]
            if scene.volume_source == "upload:mine.nrrd":
                loaded = None
            np.testing.assert_array_equal(self.recording.voxels(tick, loaded), values)
            changed.add(scene.volume_revision)
        self.assertGreater(len(changed), 5)
        self.assertGreater(len(self.recording.edits), 4)
        first, _ = self.expected["voxels"][0]
        with self.assertRaisesRegex(palpate.FailedPrecondition, "download.*load"):
            self.recording.voxels(first)
        with self.assertRaises(palpate.Conflict):
            self.recording.voxels(first, self.expected["loaded"][0] + 1)
        with self.assertRaises(palpate.InvalidArgument):
            self.recording.voxels(first, self.expected["loaded"][1])


class Damage(RecordingTest):
    def opened(self, data):
        """None: refused, with one line."""
        path = self.folder / "damaged.palrec"
        path.write_bytes(data)
        try:
            return palpate.open_recording(path)
        except palpate.InvalidArgument as refused:
            self.assertNotIn("\n", str(refused))
            return None

    def check_prefix(self, recording):
        self.assertFalse(recording.complete)
        self.assertIn("ticks", recording.ends_early)
        whole = self.recording.ticks
        for name, array in vars(recording.ticks).items():
            np.testing.assert_array_equal(array, getattr(whole, name)[:len(array)], name)
        self.assertEqual([m.text for m in recording.markers],
                         [m.text for m in self.recording.markers][:len(recording.markers)])
        self.assertLessEqual(len(recording.scenes), len(self.recording.scenes))

    def test_what_is_whole_before_the_damage_is_read(self):
        data, choose = self.path.read_bytes(), random.Random(2)
        lengths = set()
        for place in {*range(80), *range(len(data) - 60, len(data)),
                      *choose.sample(range(len(data)), 80)}:
            recording = self.opened(data[:place])
            self.assertEqual(recording is None, place < 24 + len(self.recording.program) + 16)
            if recording:
                self.check_prefix(recording)
                lengths.add(len(recording.ticks))
        self.assertGreater(len(lengths), 2)
        for place in [*range(40), *choose.sample(range(len(data)), 60)]:
            changed = bytearray(data)
            changed[place] ^= 1 << place % 8
            if recording := self.opened(changed):
                self.check_prefix(recording)
        for more in (b"x", data[60:]):
            self.check_prefix(self.opened(data + more))

    def test_what_is_no_recording(self):
        for data in (b"", b"PNG", b"\x89PLPREC\n", os.urandom(1000)):
            self.assertIsNone(self.opened(data))
        for path, error in ((self.folder / "none.palrec", palpate.NotFound),
                            (self.folder, palpate.InvalidArgument),
                            ("/dev/null", palpate.InvalidArgument)):
            with self.assertRaisesRegex(error, str(path)):
                palpate.open_recording(path)


def framed(*chunks, version=4):
    """A recording of (kind, payload), with checksums that fit."""
    header = b"\x89PLPREC\n" + struct.pack("<IIq", version, 8, 1) + b"palpated"
    data = header + struct.pack("<Q", xxhash.xxh3_64_intdigest(header))
    for number, (kind, payload) in enumerate(chunks):
        packed = zstandard.ZstdCompressor().compress(payload)
        content = struct.pack("<QHHII", number, kind, 0, len(payload), len(packed)) + packed
        data += struct.pack("<Q", xxhash.xxh3_64_intdigest(content)) + content
    return data


class Made(unittest.TestCase):
    """Chunks that no daemon writes, with checksums that fit."""

    def opened(self, data):
        with tempfile.NamedTemporaryFile() as file:
            file.write(data)
            file.flush()
            return palpate.open_recording(file.name)

    def read(self, recording):
        """All that is in it, or a refusal of one line."""
        for edit in recording.edits:
            edit.voxels()
        for scene in recording.scenes:
            for loaded in (None, np.zeros((16, 16, 16))):
                try:
                    recording.voxels(scene.tick, loaded)
                except palpate.Error as refused:
                    self.assertNotIn("\n", str(refused))

    def test_each_chunk_is_taken_or_refused(self):
        good = {"samples", "sample", "scene", "scene_unknown_setting", "scene_not_a_number",
                "scene_many_unknown_settings", "edit", "marker", "marker_long", "gap",
                "gap_of_everything", "keyframe"}
        choose = random.Random(7)
        scene = 2, corpus_recordings.scene() + struct.pack("<3dBB3i2dB", 0.05, 3.3, 0.001, 1, 1, 16,
                                                           16, 16, 0.0, 1.0, 1)
        of_version_4 = self.opened(framed(scene)).scenes[0]
        self.assertEqual(of_version_4.shape, (16, 16, 16))
        with self.assertRaises(palpate.FailedPrecondition):
            of_version_4.to_world_mm((0, 0, 0))
        for linear, is_place in ((np.eye(3), True), (np.zeros((3, 3)), False),
                                 (np.full((3, 3), np.nan), False), (np.eye(3) * np.inf, False)):
            place = struct.pack("<12d", *linear.ravel(order="F"), 1, 2, 3)
            recorded = self.opened(framed((2, scene[1] + place), version=5)).scenes[0]
            if is_place:
                np.testing.assert_array_equal(recorded.world_from_index[:3, 3], (1, 2, 3))
            else:
                with self.assertRaises(palpate.InvalidArgument):
                    recorded.to_world_mm((0, 0, 0))
        for cut in (1, 8, 95):
            self.assertIn("chunk 0", self.opened(framed(
                (2, scene[1] + bytes(cut)), version=5)).ends_early)
        for name, (kind, payload) in corpus_recordings.chunks().items():
            with self.subTest(name):
                recording = self.opened(framed((kind, payload), version=2))
                self.assertEqual("was not closed" in recording.ends_early, name in good,
                                 recording.ends_early)
                for cut in range(0, len(payload), max(1, len(payload) // 40)):
                    changed = bytearray(payload)
                    changed[cut] = choose.randrange(256)
                    self.read(self.opened(framed((kind, payload[:cut]))))
                    self.read(self.opened(framed(scene, (kind, bytes(changed)))))

    def test_an_older_version(self):
        ticks = corpus_recordings.samples([corpus_recordings.fields(n) for n in range(3)])
        recording = self.opened(framed(
            (2, corpus_recordings.scene()), (1, ticks), (7, struct.pack("<2Q", 3, 0)), version=2))
        self.assertEqual((recording.ends_early, recording.version), ("", 2))
        self.assertIsNone(recording.scenes[0].shape)
        with self.assertRaises(palpate.FailedPrecondition):
            recording.voxels(0, np.zeros((16, 16, 16)))
        for version in (1, 7):
            with self.assertRaisesRegex(palpate.InvalidArgument, f"of version {version}"):
                self.opened(framed(version=version))

    def test_markers_of_an_older_version_stand_where_their_time_says(self):
        chunks, stood = [], {5: [4000], 6: [5999, 7100], 7: [6000], 8: [7500]}
        for tick, times_ns in stood.items():  # each tick takes 1000 ns
            chunks += [(4, struct.pack("<QqI", tick, time_ns, 1) + b"m") for time_ns in times_ns]
            chunks.append((1, corpus_recordings.samples([corpus_recordings.fields(tick)])))
        recording = self.opened(framed(*chunks, version=5))
        self.assertEqual([marker.tick for marker in recording.markers], [5, 5, 7, 6, 7])
        self.assertIsNone(recording.created_monotonic_ns)
        with self.assertRaises(palpate.FailedPrecondition):
            recording.to_unix_ns(recording.ticks.time_ns)

    def test_a_bomb_is_not_unpacked(self):
        data = corpus_recordings.recording()[1:]
        header = data[:24 + 8]
        data = header + struct.pack("<Q", xxhash.xxh3_64_intdigest(header))
        packed = struct.pack("<IBQ", 0xfd2fb528, 0xe0, 1 << 50) + b"\x03\x00\x00"
        content = struct.pack("<QHHII", 0, 4, 0, 100, len(packed)) + packed
        recording = self.opened(data + struct.pack("<Q", xxhash.xxh3_64_intdigest(content))
                                + content)
        self.assertIn("chunk 0", recording.ends_early)


if __name__ == "__main__":
    unittest.main()
