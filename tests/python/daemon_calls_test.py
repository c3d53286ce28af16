"""The daemon's calls as any client may make them, by plain gRPC: messages that the client libraries
do not send, and what a call leaves behind."""

import concurrent.futures
import json
import os
import pathlib
import random
import resource
import shlex
import subprocess
import tempfile
import threading
import types
import unittest
import zlib

import grpc
import numpy as np

import palpate
from free_port import free_port
from palpate.v1 import (device_pb2, device_pb2_grpc, edit_pb2, geometry_pb2, pose_pb2,
                        pose_pb2_grpc, registration_pb2, registration_pb2_grpc, series_pb2,
                        series_pb2_grpc, volume_pb2, volume_pb2_grpc)
from support import PALPATE, PATIENCE_S, Daemon, nrrd, pattern, wait_until

BAD, ABORTED = grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.ABORTED
EXHAUSTED = grpc.StatusCode.RESOURCE_EXHAUSTED
NAN, INFINITY = float("nan"), float("inf")
DATA = pathlib.Path(os.environ["PALPATE_DATA_DIR"])
UNTURNED = np.eye(3).tolist()


def vector(x, y, z):
    return geometry_pb2.Vector3(x=x, y=y, z=z)


def spoilt(message, **changes):
    """A copy with other fields; `a__b` is b of a, and None takes a field out."""
    copy = type(message)()
    copy.CopyFrom(message)
    for path, value in changes.items():
        *parents, name = path.split("__")
        at = copy
        for parent in parents:
            at = getattr(at, parent)
        if value is None:
            at.ClearField(name)
        elif hasattr(value, "CopyFrom"):
            getattr(at, name).CopyFrom(value)
            getattr(at, name).SetInParent()
        else:
            setattr(at, name, value)
    return copy


def stubs_of(channel):
    return types.SimpleNamespace(
        channel=channel,
        device=device_pb2_grpc.DeviceServiceStub(channel),
        poses=pose_pb2_grpc.PoseServiceStub(channel),
        registration=registration_pb2_grpc.RegistrationServiceStub(channel),
        series=series_pb2_grpc.SeriesServiceStub(channel),
        volume=volume_pb2_grpc.VolumeServiceStub(channel))


class CallsTest(unittest.TestCase):
    """One daemon for all tests of a class, with a configuration of `config`."""

    volume = "builtin:bumps:64"
    config = ""
    more = ()

    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix="palpate-calls-"))).resolve()
        config = cls.root / "palpated.toml"
        config.write_text(cls.config.format(root=cls.root))
        cls.daemon = cls.enterClassContext(
            Daemon(cls.volume, more=["--config", str(config), "--load-folder", "/", *cls.more]))
        cls.conn = cls.enterClassContext(cls.daemon.connect())
        cls.stubs = stubs_of(cls.enterClassContext(
            grpc.insecure_channel("unix:" + cls.daemon.socket)))

    def refused(self, code, call, *arguments):
        """Makes a call that is refused so, in one line, which it returns."""
        with self.assertRaises(grpc.RpcError) as caught:
            answer = call(*arguments)
            if hasattr(answer, "__next__"):
                list(answer)
        self.assertEqual(caught.exception.code(), code, caught.exception.details())
        self.assertNotIn("\n", caught.exception.details())
        return caught.exception.details()

    def ticks(self):
        return self.stubs.device.GetDevice(device_pb2.GetDeviceRequest()).servo.ticks


class Requests(CallsTest):
    def test_health_and_reflection(self):
        channel = self.stubs.channel
        # A response whose field 1 is SERVING, 1; and list_services, field 7.
        self.assertEqual(channel.unary_unary("/grpc.health.v1.Health/Check")(b""), b"\x08\x01")
        reflect = channel.stream_stream(
            "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo")
        self.assertIn(b"palpate.v1.PoseService", next(reflect(iter([b"\x3a\x01*"]))))

    def test_a_stream_of_poses_begins_with_its_start(self):
        good = pose_pb2.StreamPosesRequest(start=pose_pb2.StreamPosesStart(rate_hz=5000))
        acknowledged = pose_pb2.StreamPosesRequest(
            acknowledgement=pose_pb2.StreamPosesAcknowledgement(message_number=1))
        for first in (good, acknowledged, pose_pb2.StreamPosesRequest()):
            self.refused(BAD, self.stubs.poses.StreamPoses, iter([first]))

    def test_bad_places_and_series_are_refused(self):
        place, control = registration_pb2.UpdateRegistrationRequest, series_pb2.ControlSeriesRequest
        turn = geometry_pb2.Quaternion
        before = self.conn.volume.place().settings_revision
        for bad in (place(device_mm_per_volume_mm=0), place(device_mm_per_voxel=-1),
                    place(device_mm_per_voxel=2e6), place(scale_by=NAN),
                    place(center_mm=vector(0, 2e6, 0)), place(translate_mm=vector(0, 0, INFINITY)),
                    place(rotation=turn(w=2)), place(rotate=turn()),
                    place(reset=True, scale_by=-1)):
            self.refused(BAD, self.stubs.registration.UpdateRegistration, bad)
        self.refused(ABORTED, self.stubs.registration.UpdateRegistration,
                     place(reset=True, expected_revision=99))
        self.assertEqual(self.conn.volume.place().settings_revision, before)
        for bad in ([], ["builtin:bumps:16"], ["relative.nrrd"] * 2):
            self.refused(BAD, self.stubs.series.LoadSeries,
                         series_pb2.LoadSeriesRequest(sources=bad))
        self.refused(ABORTED, self.stubs.series.ControlSeries, control())


class Edits(CallsTest):
    def setUp(self):
        self.conn.volume.load("builtin:bumps:64")
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
        cube, box = self.block(1, 2, eight), edit_pb2.BoxShape
        world = edit_pb2.EDIT_FRAME_WORLD
        refused = [edit_pb2.EditVolumeRequest(),
                   *(spoilt(self.good, **change) for change in (
                       {"sphere": None}, {"frame": 0}, {"frame": 9}, {"operation": 0},
                       {"operation": 77}, {"sphere__center": None}, {"sphere__radius": 0},
                       {"sphere__radius": NAN}, {"sphere__center__y": NAN},
                       {"sphere__center__x": -500}, {"value": NAN}, {"value": 1.5},
                       {"strength": 0}, {"strength": 1.5}, {"falloff": -1}, {"box": box()},
                       {"box": box(min=vector(30, 30, 30), max=vector(20, 20, 20))},
                       {"capsule": edit_pb2.CapsuleShape(to=vector(5, 5, 5), radius=1)})),
                   *(spoilt(cube, **change) for change in (
                       {"block__values": cube.block.values[:-1]}, {"frame": world},
                       {"operation": edit_pb2.EDIT_OPERATION_SMOOTH}, {"falloff": 1})),
                   self.block(63, 2, eight), self.block(1, 0, []), self.block(1, 3, eight),
                   self.block(4294967295, 4294967295, eight), self.block(1, 2, eight * 4),
                   self.block(1, 2, eight * NAN)]
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
        self.conn.volume.load("builtin:bumps:96")
        whole = self.block(0, 96, np.full(96 * 96 * 85, 0.25))
        answer = self.stubs.volume.EditVolume(spoilt(whole, block__size_z=85))
        self.assertGreater(answer.changed_voxels, 500_000)
        self.assertEqual(answer.changed.max_z, 84)

    def test_a_save_is_of_one_revision_while_edits_go_on(self):
        self.conn.volume.load("builtin:gyroid:128")
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

    def test_a_full_disk_leaves_no_file(self):
        process = self.daemon.process.pid
        before = resource.prlimit(process, resource.RLIMIT_FSIZE)
        resource.prlimit(process, resource.RLIMIT_FSIZE, (100, before[1]))
        self.addCleanup(resource.prlimit, process, resource.RLIMIT_FSIZE, before)
        path = self.daemon.folder / "full.vdb"
        self.refused(EXHAUSTED, self.stubs.volume.SaveVolume,
                     volume_pb2.SaveVolumeRequest(path=str(path)))
        self.assertEqual(list(self.daemon.folder.glob("*full*")), [])


class Loads(CallsTest):
    volume = "builtin:sphere:16"

    def test_a_client_that_does_not_read_holds_nobody(self):
        # Its answer has five bytes of room.
        channel = self.enterContext(grpc.insecure_channel(
            "unix:" + self.daemon.socket,
            options=[("grpc.use_local_subchannel_pool", 1), ("grpc.http2.lookahead_bytes", 5),
                     ("grpc.http2.bdp_probe", 0)]))
        unread = stubs_of(channel).volume.LoadVolume(
            volume_pb2.LoadVolumeRequest(source="builtin:sphere:64"))
        self.addCleanup(unread.cancel)
        self.assertTrue(wait_until(
            lambda: any("it does not read its answer" in line for line in self.daemon.said), 120))

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
                       {"frame": 1}, {"source": "builtin:bumps:16"}, {"raw": None}):
            with self.subTest(change):
                self.refused(BAD, self.stubs.volume.LoadVolume, spoilt(good, **change))
        self.assertEqual(self.conn.volume.info().volume_revision, before)
        *_, last = self.stubs.volume.LoadVolume(good)
        self.assertEqual((last.result.volume.size_x, last.result.volume.value_max), (4, 23.0))

    def test_one_frame_of_a_file(self):
        path = DATA / "timeseries/nibabel_functional.nii"
        if not path.exists():
            self.skipTest(f"{path} is missing")
        request = volume_pb2.LoadVolumeRequest(source=str(path))
        greatest = set()
        for frame in (0, 19):
            *_, last = self.stubs.volume.LoadVolume(spoilt(request, frame=frame))
            self.assertEqual(last.result.volume.frames, 20)
            greatest.add(last.result.volume.value_max)
        self.assertEqual(len(greatest), 2)
        for frame in (20, 0xffffffff):
            self.refused(BAD, self.stubs.volume.LoadVolume, spoilt(request, frame=frame))

    def test_a_file_that_is_no_volume_keeps_what_is_there(self):
        whole = nrrd(pattern((4, 4, 4)), UNTURNED, (0.0, 0.0, 0.0))
        before = self.conn.volume.info().volume_revision
        for content in (whole[:-9], b"no volume", b""):
            path = self.root / "bad.nrrd"
            path.write_bytes(content)
            self.refused(BAD, self.stubs.volume.LoadVolume,
                         volume_pb2.LoadVolumeRequest(source=str(path)))
        self.assertEqual(self.conn.volume.info().volume_revision, before)


class Uploads(CallsTest):
    volume = "builtin:sphere:16"
    config = '[volume]\nmax_upload_mib = 1\nupload_folder = "{root}"\n'
    file = nrrd(pattern((9, 8, 7)), UNTURNED, (0.0, 0.0, 0.0))

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


class Collected:
    """Every pose from now on, read on a thread of its own."""

    def __init__(self, conn):
        self._poses = []
        self._stream = conn.poses(1000, 16, waiting=1000)
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        if not wait_until(lambda: self._poses, PATIENCE_S):
            raise RuntimeError("no poses come")

    def _read(self):
        for poses in self._stream:
            self._poses.append(poses)

    def all(self):
        return palpate.Poses.concatenate(self._poses)

    def has(self, tick):
        return self._poses[-1].tick[-1] >= tick

    def end(self):
        self._stream.close()
        self._thread.join()
        return self.all()


def newtons(poses):
    return np.linalg.norm(poses.force_n, axis=1)


class Forces(CallsTest):
    """What an operator's calls do to the forces: counted in ticks, as the samples tell."""

    volume = "builtin:bumps:48"
    felt_n = 0.3
    slew_n_per_tick = 0.2
    ramp_out_ticks = 17  # 3.3 N

    def setUp(self):
        self.enable()
        self.collected = Collected(self.conn)
        self.addCleanup(self.collected.end)

    def enable(self):
        return self.stubs.device.EnableForces(device_pb2.EnableForcesRequest())

    def disable(self):
        return self.stubs.device.DisableForces(device_pb2.DisableForcesRequest())

    def stop(self):
        return self.stubs.device.StopForces(device_pb2.StopForcesRequest())

    def wait_for_force(self):
        with self.conn.poses(500) as stream:
            self.assertTrue(wait_until(lambda: newtons(next(stream))[-1] > self.felt_n, 120))

    def poses_of(self, call, state):
        """Calls it under a force. Returns the samples from the tick before the one that it names,
        until the forces are enabled again."""
        for _ in range(50):
            self.wait_for_force()
            answer = call()
            self.assertEqual(answer.forces.state, state)
            self.assertTrue(wait_until(lambda: self.collected.has(answer.applied_tick + 100), 60))
            enabled = self.enable().applied_tick
            poses = self.collected.all()
            at = (poses.tick >= answer.applied_tick - 1) & (poses.tick < enabled)
            tick, force_n = poses.tick[at], newtons(poses)[at]
            self.assertTrue((poses.force_state[at][tick >= answer.applied_tick] == state).all())
            if tick[0] == answer.applied_tick - 1 and force_n[0] > self.felt_n:
                return tick.astype(int) - answer.applied_tick, force_n
        self.fail("the hand felt nothing when it was called")

    def test_a_stop_is_no_force_in_its_tick(self):
        tick, force_n = self.poses_of(self.stop, device_pb2.FORCE_STATE_STOPPED)
        self.assertGreater(len(tick), 1)
        np.testing.assert_array_equal(force_n[tick >= 0], 0)

    def test_disabled_forces_go_by_the_slew_limit(self):
        tick, force_n = self.poses_of(self.disable, device_pb2.FORCE_STATE_OFF)
        np.testing.assert_array_equal(force_n[tick >= self.ramp_out_ticks], 0)
        fall_n = -np.diff(force_n)[np.diff(tick) == 1]
        self.assertTrue(((fall_n >= -1e-12) & (fall_n <= self.slew_n_per_tick + 1e-9)).all())
        self.assertGreater(force_n[1], 0)

    def test_no_force_after_the_last_stop_of_many_clients(self):
        self.wait_for_force()

        def one_client(seed):
            chance = random.Random(seed)
            for _ in range(40):
                call = chance.choice((self.enable, self.enable, self.disable, self.stop))
                try:
                    call()
                except grpc.RpcError as error:
                    # An enable may lose against another client's stop.
                    if (call, error.code()) != (self.enable, grpc.StatusCode.FAILED_PRECONDITION):
                        raise
            self.stop()  # whichever comes last is a stop

        with concurrent.futures.ThreadPoolExecutor(8) as pool:
            list(pool.map(one_client, range(8)))
        last = self.ticks()
        self.assertTrue(wait_until(lambda: self.collected.has(last + 500), 120))
        poses = self.collected.all()
        stopped = poses.force_state == palpate.ForceState.STOPPED
        self.assertTrue(stopped[poses.tick >= last].all())
        self.assertTrue((newtons(poses)[stopped] == 0).all())
        for state in (palpate.ForceState.ON, palpate.ForceState.OFF):
            self.assertTrue((poses.force_state == state).any(), state)

    def test_a_stop_does_not_wait_for_a_load(self):
        load = self.stubs.volume.LoadVolume(
            volume_pb2.LoadVolumeRequest(source="builtin:gyroid:320"))
        next(load)  # it is under way
        stopped = self.stop().applied_tick
        *_, last = load
        self.assertLess(stopped, last.result.applied_tick)


class PoseBudget(CallsTest):
    config = "[limits]\npose_samples_per_s = 4000\n"
    address = f"127.0.0.1:{free_port()}"
    more = ("--listen", address)

    def test_one_over_the_network_has_half_of_the_samples(self):
        channel = self.enterContext(grpc.insecure_channel(self.address))
        ended = threading.Event()
        self.addCleanup(ended.set)

        def requests():
            yield pose_pb2.StreamPosesRequest(
                start=pose_pb2.StreamPosesStart(rate_hz=1000, batch=1, max_unacknowledged=64))
            ended.wait()

        def ask():
            call = stubs_of(channel).poses.StreamPoses(requests())
            try:
                next(call)
            except grpc.RpcError as error:
                self.assertEqual(error.code(), EXHAUSTED)
                self.assertIn("limits.pose_samples_per_s", error.details())
                return None
            return call

        held = [ask() for _ in range(6)]
        self.assertEqual([call is not None for call in held], [True] * 2 + [False] * 4)
        # Another client is served, and what is given back can be had again.
        with self.conn.poses(1000) as stream:
            next(stream)
        for call in filter(None, held):
            call.cancel()
        self.assertTrue(wait_until(ask, 60))


class Hand(unittest.TestCase):
    def touched(self, conn):
        """Whether the hand touches in 6 of 10 ticks, of 4000 from its first contact on. Ticks that
        are missed may lead it astray: it has three goes."""
        for _ in range(3):
            contact = np.zeros(0, bool)
            with conn.poses(1000, 16, waiting=1000) as stream:
                while len(contact) < 4000:
                    contact = np.append(contact, next(stream).contact)
                    contact = contact[np.argmax(contact):] if contact.any() else contact[:0]
            print(f"{contact.mean():.2f} of the ticks in contact")
            if contact.mean() >= 0.6:
                return True
        return False

    def test_it_finds_what_is_thin(self):
        # A tube of two voxels, which a hand that searches by touch alone meets once in minutes.
        i, j, k = np.indices((96, 96, 96))
        x, y = 48 + 30 * np.sin(0.07 * k), 48 + 30 * np.cos(0.045 * k)
        values = np.clip(1.5 - 0.6 * np.hypot(i - x, j - y), 0, 1).astype(np.float32)
        with tempfile.NamedTemporaryFile(suffix=".nrrd") as file:
            file.write(nrrd(values, UNTURNED, (0.0, 0.0, 0.0)))
            file.flush()
            with Daemon(file.name, more=["--isovalue", "0.5"]) as daemon, \
                    daemon.connect() as conn:
                self.assertTrue(self.touched(conn))
                # It is somewhere else, many times its width from where it was: another plan.
                conn.volume.place(move_mm=(15, 0, 0))
                self.assertTrue(self.touched(conn))


class Tools(CallsTest):
    """The simulated hand holds both buttons now and then."""

    volume = "builtin:bumps:32"
    config = "[device]\npressed_buttons = 3\n[haptics]\ncarve_tool = true\ncarve_radius_mm = 6.0\n"

    def test_the_stylus_carves_and_moves_the_volume(self):
        before = self.conn.volume.info()
        self.assertTrue(wait_until(lambda: self.conn.volume.info().volume_revision
                                   > before.volume_revision + 5, 120))
        self.assertEqual(self.conn.volume.place().center_mm[0], 0)
        self.conn.settings.update(carve_tool=False, clutch_tool=True)
        collected = Collected(self.conn)
        self.addCleanup(collected.end)
        self.assertTrue(wait_until(lambda: self.conn.volume.place().center_mm[0] != 0
                                   and self.suspended(collected).sum() > 100, 120))
        # A move that was under way may still come.
        last = self.conn.settings.update(clutch_tool=False).applied_tick + 200
        self.assertTrue(wait_until(lambda: collected.has(last), 60))
        moved = self.conn.volume.place()
        poses = collected.end()
        suspended = self.suspended(collected)
        self.assertTrue((newtons(poses)[suspended] == 0).all())
        self.assertTrue((poses.buttons[suspended] & 2 != 0).all())
        # Kept, as if a client had moved it; and it stays without the tool.
        self.daemon.end()
        self.daemon.start()
        self.assertTrue(wait_until(self.is_connected, 60))
        np.testing.assert_array_equal(self.conn.volume.place().center_mm, moved.center_mm)

    def is_connected(self):
        try:
            return self.ticks() > 0
        except grpc.RpcError:
            return False

    @staticmethod
    def suspended(collected):
        return collected.all().mode == palpate.ProxyMode.SUSPENDED


class Memory(CallsTest):
    volume = "builtin:sphere:64"
    # Locked memory would count what is reserved, too.
    config = "[realtime]\nlock_memory = false\n[volume]\nmemory_budget_mib = 400\n"

    def resident(self):
        status = pathlib.Path(f"/proc/{self.daemon.process.pid}/status").read_text()
        return 1024 * int(status.partition("VmRSS:")[2].split()[0])

    def test_a_dense_volume_costs_little_more_than_its_voxels(self):
        edge = 256
        path = self.root / "noise.raw"
        np.random.default_rng(1).random(edge**3, np.float32).tofile(path)
        grid_bytes = 4.22 * edge**3  # a dense float tree of OpenVDB
        before = self.resident()
        raw = palpate.Raw((edge,) * 3, "float32")
        for _ in range(2):  # the second frees the first
            self.conn.volume.load(path, raw=raw)
            # The volume before is freed on a thread that the load does not wait for. The sanitizers
            # keep what was freed for a while.
            self.assertTrue("PALPATE_SANITIZED" in os.environ or wait_until(
                lambda: self.resident() - before <= 1.3 * grid_bytes, 60))

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


class CommandLine(CallsTest):
    """The command line's edits, saves, uploads, series and places. The rest: tests/cli."""

    config = "[volume]\nmax_upload_mib = 1\n"

    def palpate(self, line, code=0):
        """What it prints; of --json, the values. `@` is the daemon's folder."""
        ran = subprocess.run(
            [PALPATE, *shlex.split(line.replace("@", f"{self.daemon.folder}/")), "--socket",
             self.daemon.socket], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        self.assertEqual(ran.returncode, code, line + ran.stderr)
        if code:
            self.assertEqual(ran.stderr.count("palpate: "), 1, ran.stderr)
        return json.loads(ran.stdout) if "--json" in line and not code else ran.stdout

    def refuse(self, lines):
        for line, code in lines.items():
            with self.subTest(line):
                self.palpate(line, code)

    def test_edits_are_made_taken_back_and_saved(self):
        self.palpate("load builtin:bumps:64")
        edited = self.palpate("edit box --min-voxels 10,10,10 --max-voxels 12,12,12 "
                              "--operation set --value 0.75 --json")
        self.assertEqual((edited["changed_voxels"], edited["changed"]["max"]), (27, [12, 12, 12]))
        self.palpate("edit capsule --from-mm -1,2,3 --to-mm 9,2,3 --radius-mm 2 --falloff-mm 1 "
                     "--operation paint --value 1 --strength .5")
        self.assertEqual(self.palpate("undo --json")["redo_steps"], 1)
        self.assertEqual(self.palpate("redo --json")["undo_steps"], 2)
        self.palpate("undo --expected-revision 1", 7)
        self.palpate("revert")
        np.full(8, 0.125, np.float32).tofile(self.daemon.folder / "block.f32")
        self.assertEqual(self.palpate("edit block @block.f32 --min-voxels 1,2,3 --size-voxels "
                                      "2,2,2 --operation set --json")["changed"]["min"], [1, 2, 3])
        saved = self.palpate("save @a.nrrd --json")
        self.assertEqual(saved["size_bytes"], (self.daemon.folder / "a.nrrd").stat().st_size)
        self.palpate("save @a.nrrd", 7)
        self.palpate("save @a.nrrd --overwrite")

    def test_edits_that_make_no_sense(self):
        sphere = "edit sphere --center-voxels 9,9,9 "
        block = "edit block /none --operation set --size-voxels 2,2,2 --min-voxels "
        self.palpate(sphere + "--radius-voxels 2 --operation set --value 0.5")
        self.refuse({sphere + end: code for end, code in {
            "--radius-mm 2 --operation set --value 0.5": 2, "--operation set --value 0.5": 2,
            "--radius-voxels 2 --operation set": 2, "--radius-voxels 2 --value 0.5": 2,
            "--radius-voxels 2 --operation cut --value 0.5": 2,
            "--radius-voxels 2 --operation smooth --value 0.5": 2,
            "--radius-voxels nan --operation smooth": 2,
            "--radius-voxels 2 --operation smooth --strength 2": 2,
            "--radius-voxels -2 --operation smooth": 3}.items()}
            | {"edit": 2, block + "1,1,1": 4, block + "-1,1,1": 2})

    def test_files_are_sent(self):
        file = self.daemon.folder / "sent.nrrd"
        file.write_bytes(nrrd(pattern((9, 8, 7)), UNTURNED, (0.0, 0.0, 0.0)))
        self.palpate("upload @sent.nrrd --normalized-isovalue 0.25")
        self.assertEqual(self.conn.volume.info().source, "upload:sent.nrrd")
        (self.daemon.folder / "empty.nrrd").touch()
        (self.daemon.folder / "large.nrrd").write_bytes(bytes((1 << 20) + 1))
        self.refuse({"upload": 2, "upload @absent.nrrd": 4, "upload @": 3, "upload @empty.nrrd": 3,
                     "upload @large.nrrd": 6})
        np.arange(48, dtype=np.uint8).tofile(self.daemon.folder / "b.dat")
        self.palpate("upload @b.dat --raw-size 4,4,3 --raw-type uint8")
        self.assertEqual(self.conn.volume.info().shape, (4, 4, 3))

    def test_a_series_plays(self):
        for n in range(3):
            (self.daemon.folder / f"t{8 + n}.nrrd").write_bytes(
                nrrd(pattern((9, 8, 7)) + n, UNTURNED, (0.0, 0.0, 0.0)))
        self.palpate("series load @t*.nrrd")
        for line in ("rate -.5", "loop on", "interpolate on", "seek 1.5", "play"):
            self.palpate("series " + line)
        told = self.palpate("series info --json")
        self.assertEqual([told[key] for key in ("frames", "playing", "rate_hz", "loop",
                                                "interpolate")], [3, True, -0.5, True, True])
        self.palpate("series pause")
        self.assertFalse(self.palpate("series info --json")["playing"])
        self.refuse({"series seek 7": 3} | {f"series {line}": 2 for line in (
            "", "load", "seek", "seek x", "rate", "loop", "loop maybe", "play x", "stop")})
        self.palpate("load builtin:sphere:16")
        self.palpate("series info", 7)

    def test_a_place_is_given_and_shown(self):
        self.palpate("load builtin:bumps:32")
        placed = self.palpate("place --center-mm -.5,1,0 --turn-deg z,-90 --cells-per-mm 4 --json")
        self.assertEqual((placed["center_mm"], placed["device_mm_per_voxel"]), ([-0.5, 1, 0], 0.25))
        self.assertAlmostEqual(placed["rotation_wxyz"][3], -np.sqrt(0.5))
        self.assertGreater(placed["applied_tick"], 0)
        shown = self.palpate("place --json")
        self.assertEqual(shown["settings_revision"], placed["settings_revision"])
        self.refuse({"place --device-mm-per-voxel 1e7": 3,
                     "place --reset --expected-revision 1": 7})
        self.palpate("place --reset")
        self.assertEqual(self.palpate("place --json")["center_mm"], [0, 0, 0])


if __name__ == "__main__":
    unittest.main()
