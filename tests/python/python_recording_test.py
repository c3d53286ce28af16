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
import warnings

import numpy as np
import zstandard
from google.protobuf.message import DecodeError

import palpate
from palpate._pose_columns import RECORDED
from palpate.v1 import recorded_pb2
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
    with conn.device.lead() as hand:
        for _ in range(20):
            hand.move_to((1, 2, 3))
            time.sleep(0.02)
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
            RecordingTest.path = RecordingTest.folder / "trial.mcap"
            with Daemon() as daemon, daemon.connect() as conn:
                RecordingTest.expected = record(daemon, conn, daemon.folder / "trial.mcap")
                shutil.copy(daemon.folder / "trial.mcap", RecordingTest.path)
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
        # About a second apart, and both clocks go alike.
        self.assertGreater(len(recording.clock), 1)
        apart = np.abs(recording.to_unix_ns(recording.clock[:, 0]) - recording.clock[:, 1])
        self.assertLess(apart.max(), 10**9)

    def test_where_the_hand_was_led(self):
        led = self.recording.ticks.led_target_mm
        is_led = ~np.isnan(led).any(axis=1)
        # At first it is led to where it was.
        self.assertTrue((led[is_led][-100:] == (1, 2, 3)).all())
        self.assertTrue(0 < is_led.sum() < len(led))
        self.assertTrue(np.isnan(self.recording.ticks.series_position_frames).all())

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
            self.assertEqual(scene.unknown_settings, ())
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
        path = self.folder / "damaged.mcap"
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
        metadata = data.index(b"palpate.recording") - 4
        header_end = metadata + struct.unpack_from("<Q", data, metadata - 8)[0]
        lengths = set()
        for place in {*range(80), *range(header_end - 20, header_end + 20),
                      *range(len(data) - 60, len(data)),
                      *choose.sample(range(len(data)), 80)}:
            recording = self.opened(data[:place])
            self.assertEqual(recording is None, place < header_end)
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
        for data in (b"", b"PNG", b"\x89MCAP0\r\n", os.urandom(1000)):
            self.assertIsNone(self.opened(data))
        for path, error in ((self.folder / "none.mcap", palpate.NotFound),
                            (self.folder, palpate.InvalidArgument),
                            ("/dev/null", palpate.InvalidArgument)):
            with self.assertRaisesRegex(error, str(path)):
                palpate.open_recording(path)


def framed(*messages):
    """A recording of (topic, message), each in a chunk of its own."""
    return corpus_recordings.recording(*(
        corpus_recordings.chunk(corpus_recordings.record_of(*one)) for one in messages))


class Made(unittest.TestCase):
    """Messages that no daemon writes."""

    def opened(self, data):
        with tempfile.NamedTemporaryFile() as file:
            file.write(data)
            file.flush()
            return palpate.open_recording(file.name)

    def read(self, recording):
        """All that is in it, or a refusal of one line."""
        for read in [edit.voxels for edit in recording.edits] + [
                lambda scene=scene, loaded=loaded: recording.voxels(scene.tick, loaded)
                for scene in recording.scenes for loaded in (None, np.zeros((12, 10, 9)))]:
            try:
                read()
            except palpate.Error as refused:
                self.assertNotIn("\n", str(refused))

    def test_each_message_is_taken_or_refused(self):
        bad = {"tick_cut", "tick_empty", "tick_end_group", "tick_field_0", "tick_long_tag",
               "tick_no_mode", "tick_unknown_mode", "scene_of_no_method", "scene_without_a_place",
               "voxels_cut", "voxels_far", "voxels_tiles_many", "voxels_known_many",
               "event_no_text", "event_too_long"}
        choose = random.Random(7)
        scene = "/scene", corpus_recordings.scene()
        for name, (topic, data) in corpus_recordings.messages().items():
            with self.subTest(name):
                recording = self.opened(framed(scene, (topic, data)))
                self.assertEqual("not closed" in recording.ends_early, name not in bad,
                                 recording.ends_early)
                for cut in range(0, len(data), max(1, len(data) // 40)):
                    changed = bytearray(data)
                    changed[cut] = choose.randrange(256)
                    self.read(self.opened(framed((topic, data[:cut]))))
                    self.read(self.opened(framed(scene, (topic, bytes(changed)))))

    def test_files_of_all_kinds_end_as_they_should(self):
        whole = {"whole", "packed", "in_no_chunk", "with_a_gap", "lost_at_the_end", "missed_ticks"}
        refused = {"no_time", "no_recording", "old"}
        for name, data in corpus_recordings.files().items():
            with self.subTest(name):
                try:
                    self.assertEqual(self.opened(data).complete, name in whole)
                    self.assertNotIn(name, refused)
                except palpate.InvalidArgument as error:
                    self.assertIn(name, refused, error)

    def test_places_in_the_world(self):
        for linear, is_place in ((np.eye(3), True), (np.zeros((3, 3)), False),
                                 (np.full((3, 3), np.nan), False), (np.eye(3) * np.inf, False)):
            place = corpus_recordings.affine(linear.ravel(), (1, 2, 3))
            recorded = self.opened(framed(
                ("/scene", corpus_recordings.scene(more={9: place})))).scenes[0]
            if is_place:
                np.testing.assert_array_equal(recorded.world_from_index[:3, 3], (1, 2, 3))
            else:
                with self.assertRaises(palpate.InvalidArgument):
                    recorded.to_world_mm((0, 0, 0))
        without = self.opened(framed(("/scene", corpus_recordings.scene(more={7: b""}))))
        self.assertIn("builtin:small", repr(without.scenes))  # of a version without settings
        recording = self.opened(framed(scene := ("/scene", corpus_recordings.scene())))
        with self.assertRaises(palpate.FailedPrecondition):
            recording.scenes[0].to_world_mm((0, 0, 0))
        with self.assertRaises(palpate.FailedPrecondition):
            recording.to_unix_ns(recording.ticks.time_ns)
        self.assertIsNone(recording.created_monotonic_ns)
        self.assertEqual(self.opened(framed(scene)).scenes[0].shape, (12, 10, 9))

    def test_ticks_are_read_as_protobuf_reads_them(self):
        """The same change in all ticks, which the reader views at once."""
        choose = random.Random(11)
        vector = corpus_recordings.vector
        rows = [corpus_recordings.sample(n, (0.1 * n, 1, 2), missed=5, pose={
            5: vector((0, 0, 1)), 6: vector((n, 2, 3))}) + corpus_recordings.message(
                {9: vector((n, 5, 6)), 10: 0.25 * n}) for n in range(100, 120)]
        at_once = 0
        for number in range(1500):
            changed = [bytearray(row) for row in rows]
            if number:
                place, bits = choose.randrange(len(rows[0])), choose.randrange(1, 256)
                for row in changed:
                    row[place] ^= bits
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    ticks = [recorded_pb2.RecordedTick.FromString(bytes(row)) for row in changed]
            except (DecodeError, RuntimeWarning, SystemError):
                ticks = None
            records = [corpus_recordings.record_of("/tick", bytes(row)) for row in changed]
            recording = self.opened(corpus_recordings.recording(corpus_recordings.chunk(*records)))
            is_good = ticks and all(a.pose.tick < b.pose.tick for a, b in zip(ticks, ticks[1:]))
            is_good = is_good and all(0 < word <= most for tick in ticks for word, most in (
                (tick.pose.mode, 6), (tick.pose.free_side, 2), (tick.pose.forces.state, 7),
                (tick.pose.forces.reason, 14), (tick.force_command, 4), (tick.device_status, 3)))
            self.assertEqual("not closed" in recording.ends_early, bool(is_good), number)
            if is_good:
                at_once += 1
                self.check(recording.ticks, ticks)
        self.assertGreater(at_once, 500)

    def check(self, read, ticks):
        for name, (path, kind, _) in RECORDED.items():
            *outer, leaf = path.split(".")
            expected = []
            for tick in ticks:
                for part in outer:
                    tick = getattr(tick, part)
                held = getattr(tick, leaf)
                if isinstance(kind, str):
                    held = [getattr(held, axis) if tick.HasField(leaf) else np.nan for axis in kind]
                elif leaf == "series_position_frames" and not tick.HasField(leaf):
                    held = np.nan
                expected.append(held)
            np.testing.assert_array_equal(getattr(read, name), expected, name)

    def test_good_ticks_before_a_bad_one_are_kept(self):
        for bad in (corpus_recordings.sample(60, (0, 0, 1), mode=9),
                    corpus_recordings.sample(30, (0, 0, 1))):
            rows = [corpus_recordings.sample(n, (0, 0, 1)) for n in range(30, 70)]
            rows[30] = bad
            recording = self.opened(corpus_recordings.recording(corpus_recordings.chunk(
                *[corpus_recordings.record_of("/tick", row) for row in rows])))
            np.testing.assert_array_equal(recording.ticks.tick, range(30, 60))
            self.assertFalse(recording.complete)

    def test_a_word_is_its_lower_32_bits_as_in_protobuf(self):
        rows = [corpus_recordings.sample(n, (0, 0, 1), mode=(1 << 32) + 2) for n in range(20)]
        self.assertEqual(recorded_pb2.RecordedTick.FromString(rows[0]).pose.mode, 2)
        recording = self.opened(corpus_recordings.recording(corpus_recordings.chunk(
            *[corpus_recordings.record_of("/tick", row) for row in rows])))
        np.testing.assert_array_equal(recording.ticks.mode, [2] * 20)
        # So is a tag: this one is that of `docked`.
        rows = [corpus_recordings.sample(n) + b"\xa0\x80\x80\x80\x10\x01" for n in range(20)]
        recording = self.opened(corpus_recordings.recording(corpus_recordings.chunk(
            *[corpus_recordings.record_of("/tick", row) for row in rows])))
        self.check(recording.ticks, [recorded_pb2.RecordedTick.FromString(row) for row in rows])

    def test_what_is_declared_twice_is_the_first_and_no_schema_has_the_number_0(self):
        tick = corpus_recordings.record_of("/tick", corpus_recordings.sample(5))
        text, record = corpus_recordings.text, corpus_recordings.record
        again = record(12, text("palpate.recording") + corpus_recordings.texts(created_unix_ns="7"))
        recording = self.opened(corpus_recordings.recording(again, corpus_recordings.chunk(tick)))
        self.assertEqual(recording.created_unix_ns, 1)
        none = record(3, struct.pack("<H", 0) + text("palpate.v1.RecordedTick") + text("protobuf") +
                      text(""))
        other = record(4, struct.pack("<HH", 50, 0) + text("/tick") + text("json") +
                       corpus_recordings.texts())
        foreign = bytearray(corpus_recordings.record_of("/tick", corpus_recordings.sample(6)))
        struct.pack_into("<H", foreign, 9, 50)
        recording = self.opened(corpus_recordings.recording(
            none, other, corpus_recordings.chunk(tick, bytes(foreign))))
        np.testing.assert_array_equal(recording.ticks.tick, [5])

    def test_lost_ticks_at_the_end_follow_whatever_came_last(self):
        keyframe = corpus_recordings.message({1: 10, 2: corpus_recordings.keyframe(tick=10)})
        recording = self.opened(corpus_recordings.recording(corpus_recordings.chunk(
            *[corpus_recordings.record_of("/tick", corpus_recordings.sample(n)) for n in range(4)],
            corpus_recordings.record_of("/keyframe", keyframe)), corpus_recordings.end(4, 11)))
        self.assertEqual(recording.gaps, (palpate.RecordedGap(4, 9), palpate.RecordedGap(10, 14)))
        self.assertTrue(recording.complete)

    def test_small_files_do_not_become_large(self):
        event = corpus_recordings.record_of("/event", corpus_recordings.event("a"))
        chunk = corpus_recordings.chunk(packing="zstd", packed=zstandard.ZstdCompressor().compress(
            event * 200_000), size=len(event) * 200_000)
        self.assertLess(len(self.opened(corpus_recordings.recording(chunk)).markers), 100_000)
        zeros = bytes(16 << 20)
        packed = zstandard.ZstdCompressor().compress(corpus_recordings.record(99, zeros[:-9]))
        bomb = corpus_recordings.chunk(packing="zstd", packed=packed, size=len(zeros))
        recording = self.opened(corpus_recordings.recording(*[bomb] * 40))
        self.assertRegex(recording.ends_early, "more than a file of its size")
        # zstd would take the memory that its frame asks for.
        packed = struct.pack("<IBQ", 0xfd2fb528, 0xe0, 1 << 50) + b"\x03\x00\x00"
        recording = self.opened(corpus_recordings.recording(
            corpus_recordings.chunk(packing="zstd", packed=packed, size=100)))
        self.assertIn("another size", recording.ends_early)


if __name__ == "__main__":
    unittest.main()
