"""Clients that name files which they should not reach, over TLS with a token that may
load, save and record: nothing gets in or out, and the log has each with its peer."""

import os
import pathlib
import struct
import tempfile
import unittest

import grpc

from palpate.v1 import (recording_pb2, recording_pb2_grpc, series_pb2, series_pb2_grpc, volume_pb2,
                        volume_pb2_grpc)
from secured import SecuredDaemon, wait_for

SECRET = bytes(range(1, 65)) * 64
HEADER = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 16 16 16\nspacings: 1 1 1\nencoding: raw\n"


def tiff_slice():
    """16 x 16 of 8 bits."""
    tags = {256: 16, 257: 16, 258: 8, 259: 1, 262: 1, 273: 122, 277: 1, 278: 16, 279: 256}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + SECRET[:256]


def tree(folder):
    """What is in it: names, kinds, contents, times."""
    state = {}
    for path in sorted(folder.rglob("*")):
        info = path.lstat()
        content = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
        state[str(path)] = (info.st_mode, info.st_size, info.st_mtime_ns, content)
    return state


class PathsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix="palpate-paths-"))).resolve()
        for name in ("security", "load", "load/deep", "gone", "save", "outside"):
            (cls.root / name).mkdir()
        good = HEADER + b"\n" + SECRET
        for name in ("load/good.nrrd", "outside/secret.nrrd"):
            (cls.root / name).write_bytes(good)
        (cls.root / "outside/secret.raw").write_bytes(SECRET)
        (cls.root / "load/climbs.nhdr").write_bytes(HEADER + b"data file: ../outside/secret.raw\n")
        (cls.root / "load/absolute.nhdr").write_bytes(
            HEADER + b"data file: " + os.fsencode(cls.root) + b"/outside/secret.raw\n")
        for name, leads_to in (("linked", "../outside/secret.raw"), ("kept", "deep/voxels.raw")):
            (cls.root / f"load/{name}.nhdr").write_bytes(
                HEADER + b"data file: " + name.encode() + b".raw\n")
            (cls.root / f"load/{name}.raw").symlink_to(leads_to)
        (cls.root / "load/deep/voxels.raw").write_bytes(SECRET)
        for kind, first in (("tif", tiff_slice()), ("dcm", b"")):
            folder = cls.root / f"load/{kind}"
            folder.mkdir()
            (folder / f"slice_1.{kind}").write_bytes(first)
            (folder / f"slice_2.{kind}").symlink_to("../../outside/secret.raw")
        for folder in ("load", "save"):
            (cls.root / folder / "way_out").symlink_to(cls.root / "outside")
            (cls.root / folder / "link.nrrd").symlink_to("../outside/secret.nrrd")
            (cls.root / folder / "zero.nrrd").symlink_to("/dev/zero")
            (cls.root / folder / "circle.nrrd").symlink_to("circle.nrrd")
            os.mkfifo(cls.root / folder / "pipe.nrrd")
        (cls.root / "save/dangling.nrrd").symlink_to(cls.root / "outside/new.nrrd")
        (cls.root / "save/partial.palrec.partial").symlink_to(cls.root / "outside/secret.raw")
        cls.daemon = cls.enterClassContext(SecuredDaemon(cls.root / "security", f"""
[volume]
load_folders = ["{cls.root}/gone", "{cls.root}/load"]
save_folders = ["{cls.root}/save"]
""", str(cls.root / "load/link.nrrd")))  # whoever starts it may lead anywhere
        # As when a disk is taken away.
        (cls.root / "gone").rmdir()

    def setUp(self):
        # An identity of its own, for its own lines in the log.
        self.name = self.id().rpartition("test_")[2]
        self.channel = self.daemon.channel(self.daemon.add_token(self.name, "operator"))
        self.addCleanup(self.channel.close)
        self.volume = volume_pb2_grpc.VolumeServiceStub(self.channel)
        self.series = series_pb2_grpc.SeriesServiceStub(self.channel)
        self.recording = recording_pb2_grpc.RecordingServiceStub(self.channel)
        wait_for(self.is_known, "the new token")
        self.before = tree(self.root / "save"), tree(self.root / "outside"), self.felt()
        self.since = len(self.daemon.said)

    def is_known(self):
        try:
            return self.felt() is not None
        except grpc.RpcError:
            return False

    def felt(self):
        return self.volume.GetVolume(volume_pb2.GetVolumeRequest(), timeout=20.0)

    def outside(self, folder):
        """Paths that lead out of the folder, or to no plain file in it."""
        root, inside = str(self.root), str(self.root / folder)
        return [f"{root}/outside/secret.nrrd", f"{inside}/../outside/secret.nrrd",
                f"{inside}/deep/../../outside/secret.nrrd", f"{inside}/way_out/secret.nrrd",
                f"{inside}/link.nrrd", f"{inside}/circle.nrrd", f"{inside}s/x.nrrd",
                "/etc/passwd", "/dev/zero", "/proc/self/mem", f"/proc/self/root{root}/outside/x",
                f"{inside}/zero.nrrd", f"{inside}/pipe.nrrd", "relative.nrrd", "../outside/x", ""]

    def odd(self, folder):
        """Paths that are none, or would do something to the log."""
        inside = str(self.root / folder)
        return [f"{inside}/good.nrrd\0.vdb", "/" + "a" * 5000, inside + "/x" * 5000,
                "/" + "b" * 3_000_000, f"{inside}/x\nforged: ready on everything",
                f"{inside}/\x1b[2J\rx"]

    def check_refused(self, what, ask, paths):
        """Each is refused in one short line, changes nothing, and is logged."""
        for path in paths:
            with self.subTest(path=path[:80]):
                with self.assertRaises(grpc.RpcError) as refused:
                    ask(path)
                self.assertIn(refused.exception.code(), (
                    grpc.StatusCode.PERMISSION_DENIED, grpc.StatusCode.INVALID_ARGUMENT,
                    grpc.StatusCode.NOT_FOUND), refused.exception.details())
                line = refused.exception.details()
                self.assertTrue(0 < len(line) < 1000 and "\n" not in line, line[:200])
                # A line that repeats itself is there once.
                parts = (f"{what} of token {self.name} at ipv4:127.0.0.1:", f"failed: {line}")
                wait_for(lambda: any(all(part in said for part in parts)
                                     for said in self.daemon.said[self.since:]), f"{parts}", 20.0)
        self.assertEqual(tree(self.root / "save"), self.before[0])
        self.assertEqual(tree(self.root / "outside"), self.before[1])
        self.assertEqual(self.felt(), self.before[2])
        said = self.daemon.said[self.since:]
        self.assertLess(max(map(len, said)), 3000)
        self.assertFalse([line for line in said if line.startswith("forged") or "\x1b" in line])

    def load(self, path):
        request = volume_pb2.LoadVolumeRequest(source=path)
        if "tif" in path:
            request.spacing_mm.x = request.spacing_mm.y = request.spacing_mm.z = 1.0
        return list(self.volume.LoadVolume(request, timeout=60.0))

    def load_raw(self, path):
        request = volume_pb2.LoadVolumeRequest(source=path)
        request.raw.size_x = request.raw.size_y = request.raw.size_z = 16
        request.raw.type = volume_pb2.VOXEL_TYPE_UINT8
        return list(self.volume.LoadVolume(request, timeout=60.0))

    def save(self, path):
        return list(self.volume.SaveVolume(
            volume_pb2.SaveVolumeRequest(path=path, overwrite=True), timeout=60.0))

    def record(self, path):
        return self.recording.StartRecording(
            recording_pb2.StartRecordingRequest(path=path, overwrite=True), timeout=60.0)

    def play(self, path):
        return list(self.recording.Replay(recording_pb2.ReplayRequest(path=path), timeout=60.0))

    def load_series(self, path):
        return list(self.series.LoadSeries(series_pb2.LoadSeriesRequest(sources=[path]),
                                           timeout=60.0))

    def test_loads(self):
        more = [str(self.root / "load" / name) for name in ("climbs.nhdr", "absolute.nhdr")]
        self.check_refused("LoadVolume", self.load, self.outside("load") + more)

    def test_links_beside_what_is_loaded(self):
        # The source may be loaded; what it leads to may not.
        load = self.root / "load"
        for source, link in ((load / "linked.nhdr", "linked.raw"), (load / "tif", "slice_2.tif"),
                             (load / "tif/slice_1.tif", "slice_2.tif"),
                             (load / "dcm", "slice_2.dcm")):
            self.check_refused("LoadVolume", self.load, [str(source)])
            with self.assertRaises(grpc.RpcError) as refused:
                self.load(str(source))
            self.assertEqual(refused.exception.code(), grpc.StatusCode.PERMISSION_DENIED, source)
            self.assertIn(f"{link} is a link", refused.exception.details())
            self.assertIn("volume.load_folders", refused.exception.details())

    def test_odd_loads(self):
        self.check_refused("LoadVolume", self.load, self.odd("load"))

    def test_raw_loads(self):
        self.check_refused("LoadVolume", self.load_raw, self.outside("load"))

    def test_saves(self):
        more = [str(self.root / "save"), str(self.root / "save/dangling.nrrd")]
        self.check_refused("SaveVolume", self.save, self.outside("save") + more)

    def test_odd_saves(self):
        self.check_refused("SaveVolume", self.save, self.odd("save"))

    def test_recordings(self):
        more = [str(self.root / "save/dangling.nrrd")]
        self.check_refused("StartRecording", self.record, self.outside("save") + more)

    def test_what_lies_beside_a_recording_is_not_opened(self):
        # Under the name that unfinished files had once: a link, and a pipe that nobody reads.
        save = self.root / "save"
        secret = (self.root / "outside/secret.raw").read_bytes()
        os.mkfifo(save / "pipe.palrec.partial")
        for name in ("partial.palrec", "pipe.palrec"):
            self.record(str(save / name))
            self.recording.StopRecording(recording_pb2.StopRecordingRequest(), timeout=20.0)
            self.assertGreater((save / name).stat().st_size, 0)
            (save / name).unlink()
        self.assertEqual((self.root / "outside/secret.raw").read_bytes(), secret)
        (save / "pipe.palrec.partial").unlink()

    def test_odd_recordings(self):
        self.check_refused("StartRecording", self.record, self.odd("save"))

    def test_replays(self):
        self.check_refused("Replay", self.play, self.outside("load"))

    def test_odd_replays(self):
        self.check_refused("Replay", self.play, self.odd("load"))

    def test_series(self):
        more = [f"{self.root}/outside/*.nrrd", f"{self.root}/load/way_out/*",
                f"{self.root}/load/../*/secret.nrrd"]
        self.check_refused("LoadSeries", self.load_series, self.outside("load") + more)

    def test_odd_series(self):
        stars = [path + "*" for path in self.odd("load")]
        self.check_refused("LoadSeries", self.load_series, self.odd("load") + stars)

    def test_what_may_be_loaded_and_saved_still_may(self):
        self.load(str(self.root / "load/deep/../good.nrrd"))
        # A link that stays below the folder.
        self.load(str(self.root / "load/kept.nhdr"))
        self.save(str(self.root / "save/ours.vdb"))
        (self.root / "save/ours.vdb").unlink()


if __name__ == "__main__":
    unittest.main()
