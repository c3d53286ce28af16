"""The daemon's calls as any client may make them: messages that the client libraries do not send,
and what a call leaves behind."""

import os
import pathlib
import threading
import unittest
import zlib

import grpc
import numpy as np

import palpate
from calls import ABORTED, BAD, EXHAUSTED, CallsTest, spoilt, vector
from palpate.v1 import edit_pb2, geometry_pb2, pose_pb2, registration_pb2, series_pb2, volume_pb2
from support import PATIENCE_S, Client, nrrd, pattern, wait_until

NAN, INFINITY = float("nan"), float("inf")


class Requests(CallsTest):
    def test_health_and_reflection(self):
        channel = self.stubs.channel
        # A response whose field 1 is SERVING, 1; and list_services, field 7.
        self.assertEqual(channel.unary_unary("/grpc.health.v1.Health/Check")(b""), b"\x08\x01")
        reflect = channel.stream_stream(
            "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo")
        self.assertIn(b"palpate.v1.PoseService", next(reflect(iter([b"\x3a\x01*"]))))

    def test_bad_places_and_series_are_refused(self):
        """registration_test has more of the first."""
        place, control = registration_pb2.UpdateRegistrationRequest, series_pb2.ControlSeriesRequest
        before = self.conn.volume.place().settings_revision
        for bad in (place(device_mm_per_volume_mm=0), place(device_mm_per_voxel=-1),
                    place(scale_by=NAN), place(center_mm=vector(0, 2e6, 0)),
                    place(translate_mm=vector(0, 0, INFINITY)),
                    place(rotation=geometry_pb2.Quaternion(w=2)),
                    place(rotate=geometry_pb2.Quaternion()), place(reset=True, scale_by=-1)):
            self.refused(BAD, self.stubs.registration.UpdateRegistration, bad)
        self.refused(ABORTED, self.stubs.registration.UpdateRegistration,
                     place(reset=True, expected_revision=99))
        self.assertEqual(self.conn.volume.place().settings_revision, before)
        for bad in ([], ["builtin:bumps:16"], ["relative.nrrd"] * 2):
            self.refused(BAD, self.stubs.series.LoadSeries,
                         series_pb2.LoadSeriesRequest(sources=bad))
        self.refused(ABORTED, self.stubs.series.ControlSeries, control())
        # Each frame would cost a process of the importer.
        many = self.root / "many.nrrd"
        many.write_bytes(b"NRRD0004\ntype: uint8\ndimension: 4\nsizes: 2 2 2 10001\n"
                         b"kinds: domain domain domain time\nspacings: 1 1 1 1\nencoding: raw\n\n"
                         + bytes(range(8)) * 10001)
        self.refused(EXHAUSTED, self.stubs.series.LoadSeries,
                     series_pb2.LoadSeriesRequest(sources=[str(many)]))

    def test_names_that_the_importer_would_get_as_arguments_are_short_texts(self):
        path = self.root / "plain.nrrd"
        path.write_bytes(nrrd(pattern((4, 4, 4))))
        for field in ("grid", "component"):
            for name in ("g" * 257, "a\nb", "\x7f"):
                said = self.refused(BAD, self.stubs.volume.LoadVolume, volume_pb2.LoadVolumeRequest(
                    source=str(path), **{field: name}))
                self.assertIn(f"`{field}`", said)

    def test_a_stream_of_poses_begins_with_its_start(self):
        good = pose_pb2.StreamPosesRequest(start=pose_pb2.StreamPosesStart(rate_hz=5000))
        acknowledged = pose_pb2.StreamPosesRequest(
            acknowledgement=pose_pb2.StreamPosesAcknowledgement(message_number=1))
        for first in (good, acknowledged, pose_pb2.StreamPosesRequest()):
            self.refused(BAD, self.stubs.poses.StreamPoses, iter([first]))


class Edits(CallsTest):
    def setUp(self):
        self.conn.volume.load("builtin:bumps:64", discard_edits=True)
        self.good = edit_pb2.EditVolumeRequest(
            frame=edit_pb2.EDIT_FRAME_INDEX, operation=edit_pb2.EDIT_OPERATION_SET, value=0.5,
            sphere=edit_pb2.SphereShape(center=vector(20, 20, 20), radius=5))

    def block(self, low, size, values):
        block = edit_pb2.DenseBlock(min_x=low, min_y=low, min_z=low, size_x=size, size_y=size,
                                    size_z=size, values=np.float32(values).tobytes())
        return spoilt(self.good, block=block)

    def test_bad_edits_have_their_status_and_change_nothing(self):
        before = self.conn.volume.info().volume_revision
        eight = np.full(8, 0.5)
        cube, world = self.block(1, 2, eight), edit_pb2.EDIT_FRAME_WORLD
        # Of each kind one: edit_refusal_test has the others.
        refused = [edit_pb2.EditVolumeRequest(),
                   *(spoilt(self.good, **change) for change in (
                       {"sphere": None}, {"frame": 0}, {"frame": 9}, {"operation": 0},
                       {"operation": 77}, {"sphere__center": None}, {"sphere__radius": NAN},
                       {"value": NAN}, {"strength": 0}, {"falloff": -1},
                       {"box": edit_pb2.BoxShape()},
                       {"capsule": edit_pb2.CapsuleShape(to=vector(5, 5, 5), radius=1)})),
                   *(spoilt(cube, **change) for change in (
                       {"block__values": cube.block.values[:-1]}, {"frame": world},
                       {"operation": edit_pb2.EDIT_OPERATION_SMOOTH}, {"falloff": 1})),
                   self.block(63, 2, eight), self.block(1, 3, eight),
                   self.block(4294967295, 4294967295, eight)]
        for n, request in enumerate(refused):
            with self.subTest(n):
                self.refused(BAD, self.stubs.volume.EditVolume, request)
        self.refused(EXHAUSTED, self.stubs.volume.EditVolume,
                     self.block(0, 64, np.full((3 << 18) + 1, 0.5)))
        for stale, call in ((self.good, self.stubs.volume.EditVolume),
                            (edit_pb2.UndoEditRequest(), self.stubs.volume.UndoEdit),
                            (edit_pb2.RedoEditRequest(), self.stubs.volume.RedoEdit),
                            (edit_pb2.RevertVolumeRequest(), self.stubs.volume.RevertVolume)):
            said = self.refused(ABORTED, call, spoilt(stale, expected_revision=before + 1))
            self.assertIn(str(before), said)
        self.assertEqual(self.conn.volume.info().volume_revision, before)
        self.assertEqual(self.stubs.volume.EditVolume(self.good).undo_steps, 1)

    def test_the_largest_block_is_taken(self):
        self.conn.volume.load("builtin:bumps:96", discard_edits=True)
        whole = self.block(0, 96, np.full(96 * 96 * 85, 0.25))
        answer = self.stubs.volume.EditVolume(spoilt(whole, block__size_z=85))
        self.assertGreater(answer.changed_voxels, 500_000)
        self.assertEqual(answer.changed.max_z, 84)

    def test_a_save_is_of_one_revision_while_edits_go_on(self):
        self.conn.volume.load("builtin:gyroid:128", discard_edits=True)
        paths = (str(self.daemon.folder / f"{n}.nrrd") for n in range(60))
        for path in paths:
            save = self.stubs.volume.SaveVolume(volume_pb2.SaveVolumeRequest(path=path))
            next(save)  # it is under way
            second = self.stubs.volume.SaveVolume(volume_pb2.SaveVolumeRequest(path=next(paths)))
            try:
                list(second)
            except grpc.RpcError as error:
                self.assertEqual(error.code(), ABORTED)
            edited = self.stubs.volume.EditVolume(
                spoilt(self.good, operation=edit_pb2.EDIT_OPERATION_SUBTRACT, value=0.01))
            *_, last = save
            self.assertEqual(last.result.volume_revision, edited.volume_revision - 1)
            self.assertEqual(last.result.size_bytes, pathlib.Path(path).stat().st_size)
            if second.code() == ABORTED:
                return
        self.fail("no save met another one")


class Loads(CallsTest):
    volume = "builtin:sphere:16"

    def test_a_client_that_does_not_read_holds_nobody(self):
        # Its answer has five bytes of room.
        client = self.enterContext(Client(self.daemon, options=[
            ("grpc.http2.lookahead_bytes", 5), ("grpc.http2.bdp_probe", 0)]))
        unread = client.volume.LoadVolume(volume_pb2.LoadVolumeRequest(source="builtin:sphere:64"))
        self.addCleanup(unread.cancel)
        self.assertTrue(wait_until(
            lambda: any("loaded builtin:sphere:64" in line for line in self.daemon.said), 120))

        def loads():
            try:
                return self.conn.volume.load("builtin:sphere:32")
            except palpate.Conflict:
                return None
        self.assertTrue(wait_until(loads, 120))

    def test_bad_statements_about_raw_voxels_are_refused(self):
        path = self.root / "a.dat"
        path.write_bytes(np.arange(24, dtype="<u2").tobytes())
        good = volume_pb2.LoadVolumeRequest(source=str(path), raw=volume_pb2.RawVoxels(
            size_x=4, size_y=3, size_z=2, type=volume_pb2.VOXEL_TYPE_UINT16))
        before = self.conn.volume.info().volume_revision
        for change in ({"raw__type": 0}, {"raw__type": 77},
                       {"raw__type": volume_pb2.VOXEL_TYPE_UINT8}, {"raw__size_z": 3},
                       {"raw__size_x": 0}, {"raw__offset_bytes": 1}, {"raw__offset_bytes": 1 << 63},
                       {"frame": 1}, {"frame": 0xffffffff}, {"source": "builtin:bumps:16"},
                       {"raw": None}):
            with self.subTest(change):
                self.refused(BAD, self.stubs.volume.LoadVolume, spoilt(good, **change))
        self.assertEqual(self.conn.volume.info().volume_revision, before)
        *_, last = self.stubs.volume.LoadVolume(good)
        self.assertEqual((last.result.volume.size_x, last.result.volume.value_max), (4, 23.0))


class Uploads(CallsTest):
    volume = "builtin:sphere:16"
    config = '[volume]\nmax_upload_mib = 1\nupload_folder = "{root}"\n'
    file = nrrd(pattern((9, 8, 7)))

    def setUp(self):
        self.start = volume_pb2.UploadVolumeStart(name="a.nrrd", size_bytes=len(self.file),
                                                  crc32=zlib.crc32(self.file))
        # Whatever happened, nothing is left.
        self.addCleanup(lambda: self.assertTrue(wait_until(self.is_empty, 60)))

    def is_empty(self):
        return [path.name for path in self.root.iterdir()] == ["palpated.toml"]

    def upload(self, *messages):
        """Each is a start, or data."""
        return self.stubs.volume.UploadVolume(
            volume_pb2.UploadVolumeRequest(data=one) if isinstance(one, bytes)
            else volume_pb2.UploadVolumeRequest(start=one) for one in messages)

    def test_the_start_says_what_comes_and_how_it_is_loaded(self):
        start = spoilt(self.start, options__isovalue=321.0, options__source="/ignored")
        answer = self.upload(start, *(self.file[n:n + 1000]
                                      for n in range(0, len(self.file), 1000)))
        self.assertEqual((answer.volume.source, answer.volume.size_x), ("upload:a.nrrd", 9))
        self.assertEqual(self.conn.settings.isovalue, 321.0)
        self.assertGreater(answer.applied_tick, 0)

    def test_what_does_not_fit_is_refused(self):
        before = self.conn.volume.info().volume_revision
        large = bytes((1 << 20) + 1)
        for messages in ([], [self.file], [self.start, self.start],
                         [spoilt(self.start, size_bytes=1 << 20), large],
                         [self.start, self.file + b"x"], [self.start, self.file[1:]],
                         [spoilt(self.start, crc32=self.start.crc32 + 1), self.file],
                         [spoilt(self.start, name="../a.nrrd"), self.file],
                         [spoilt(self.start, name="a.txt"), self.file],
                         [spoilt(self.start, options__frame=1), self.file]):
            said = self.refused(BAD, self.upload, *messages)
            # Where it lay is nothing to a client.
            self.assertNotIn(str(self.root), said)
        self.assertEqual(self.conn.volume.info().volume_revision, before)

    def unfinished(self, start, *data):
        """An upload that sends this and no more. Nothing tells that it has ended."""
        held = threading.Event()
        self.addCleanup(held.set)

        def messages():
            yield volume_pb2.UploadVolumeRequest(start=start)
            for one in data:
                yield volume_pb2.UploadVolumeRequest(data=one)
            held.wait()
        return self.stubs.volume.UploadVolume.future(messages())

    def test_too_large_is_refused_before_it_is_sent(self):
        call = self.unfinished(spoilt(self.start, size_bytes=(1 << 20) + 1))
        self.assertIn("volume.max_upload_mib", self.refused(EXHAUSTED, call.result, PATIENCE_S))

    def test_one_that_breaks_off_leaves_nothing(self):
        before = self.conn.volume.info().volume_revision
        call = self.unfinished(self.start, self.file[:100])
        self.assertTrue(wait_until(lambda: not self.is_empty(), 60))
        call.cancel()
        self.assertTrue(wait_until(self.is_empty, 60))
        self.assertEqual(self.conn.volume.info().volume_revision, before)


class Memory(CallsTest):
    volume = "builtin:sphere:64"
    # Locked memory would count what is reserved, too.
    config = "[realtime]\nlock_memory = false\n[volume]\nmemory_budget_mib = 400\n"

    def test_a_dense_volume_costs_little_more_than_its_voxels(self):
        edge = 256
        path = self.root / "noise.raw"
        np.random.default_rng(1).random(edge**3, np.float32).tofile(path)
        grid_bytes = 4.22 * edge**3  # a dense float tree of OpenVDB
        before = self.daemon.resident_bytes()
        raw = palpate.Raw((edge,) * 3, "float32")
        for _ in range(2):  # the second frees the first
            self.conn.volume.load(path, raw=raw)
            # The volume before is freed on a thread that the load does not wait for. The sanitizers
            # keep what was freed for a while.
            self.assertTrue("PALPATE_SANITIZED" in os.environ or wait_until(
                lambda: self.daemon.resident_bytes() - before <= 1.3 * grid_bytes, 60))

    @unittest.skipIf("PALPATE_SANITIZED" in os.environ, "the sanitizers keep what was freed")
    def test_a_volume_is_held_in_the_type_of_its_file(self):
        edge = 256
        values = np.random.default_rng(1).integers(0, 100, edge**3)
        self.conn.volume.load("builtin:sphere:64")
        raw = {}
        for kind in ("float32", "int16", "uint8"):
            path = self.root / f"{kind}.raw"
            values.astype(kind).tofile(path)
            raw[kind] = (path, palpate.Raw((edge,) * 3, kind))
        before = self.daemon.resident_bytes()
        taken = {}
        for kind, (path, layout) in raw.items():
            self.conn.volume.load(path, raw=layout)
            share = {"float32": 1.3, "int16": 0.6, "uint8": 0.35}[kind]
            whole = taken.get("float32", 4.22 * edge**3)
            # What the load before took is freed on a thread of its own.
            wait_until(lambda whole=whole, share=share:
                       self.daemon.resident_bytes() - before <= share * whole, 60)
            taken[kind] = self.daemon.resident_bytes() - before
            self.assertLessEqual(taken[kind], share * whole, kind)

    def test_too_much_is_refused_in_advance_and_the_volume_stays(self):
        self.conn.volume.load("builtin:sphere:64")
        before = self.conn.volume.info().volume_revision
        # Sparse: its size alone is known.
        path = self.root / "sparse.raw"
        with open(path, "wb") as file:
            file.truncate(1 << 30)
        raw = volume_pb2.RawVoxels(size_x=1024, size_y=1024, size_z=1024,
                                   type=volume_pb2.VOXEL_TYPE_UINT8)
        for request in (volume_pb2.LoadVolumeRequest(source=str(path), raw=raw),
                        volume_pb2.LoadVolumeRequest(source="builtin:bumps:512")):
            said = self.refused(EXHAUSTED, self.stubs.volume.LoadVolume, request)
            self.assertIn("volume.memory_budget_mib", said)
            self.assertIn("400 MiB", said)
        self.assertEqual(self.conn.volume.info().volume_revision, before)
        for _ in range(4):  # what fits goes in, again and again
            self.conn.volume.load("builtin:bumps:200")


if __name__ == "__main__":
    unittest.main()
