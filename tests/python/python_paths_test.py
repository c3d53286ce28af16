"""Clients that name files which they should not reach: nothing gets in or out, and the log has each
with its peer. What a path leads to is judged in path_policy_test; here, that every call asks."""

import os
import pathlib
import struct
import tempfile
import unittest

import grpc

import palpate
from palpate.v1 import (recording_pb2, recording_pb2_grpc, series_pb2, series_pb2_grpc, volume_pb2,
                        volume_pb2_grpc)
from secured import SecuredDaemon
from support import CALL_S, Daemon, wait_until

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


class PathCalls:
    """The calls that take a path."""

    def __init__(self, channel):
        self._volume = volume_pb2_grpc.VolumeServiceStub(channel)
        self._series = series_pb2_grpc.SeriesServiceStub(channel)
        self._recording = recording_pb2_grpc.RecordingServiceStub(channel)
        self.loads = {"LoadVolume": self.load, "LoadVolume-raw": self.load_raw,
                      "LoadSeries": self.load_series, "Replay": self.play}
        self.saves = {"SaveVolume": self.save, "StartRecording": self.record}

    def felt(self):
        return self._volume.GetVolume(volume_pb2.GetVolumeRequest(), timeout=CALL_S)

    def load(self, path):
        request = volume_pb2.LoadVolumeRequest(source=path)
        if "tif" in path:
            request.spacing_mm.x = request.spacing_mm.y = request.spacing_mm.z = 1.0
        return list(self._volume.LoadVolume(request, timeout=CALL_S))

    def raw_request(self, path):
        """As many bytes as any file of the daemon's has at least."""
        request = volume_pb2.LoadVolumeRequest(source=path)
        request.raw.size_x, request.raw.size_y, request.raw.size_z = 2, 2, 10
        request.raw.type = volume_pb2.VOXEL_TYPE_UINT8
        return request

    def load_raw(self, path):
        return list(self._volume.LoadVolume(self.raw_request(path), timeout=CALL_S))

    def load_series(self, path):
        request = series_pb2.LoadSeriesRequest(sources=[path])
        request.options.raw.CopyFrom(self.raw_request(path).raw)
        return list(self._series.LoadSeries(request, timeout=CALL_S))

    def play(self, path):
        return list(self._recording.Replay(recording_pb2.ReplayRequest(path=path), timeout=CALL_S))

    def save(self, path):
        return list(self._volume.SaveVolume(
            volume_pb2.SaveVolumeRequest(path=path, overwrite=True), timeout=CALL_S))

    def record(self, path):
        return self._recording.StartRecording(
            recording_pb2.StartRecordingRequest(path=path, overwrite=True), timeout=CALL_S)


class SecuredTest(unittest.TestCase):
    """A daemon over TLS, and the calls of one who may load, save and record."""

    REFUSALS = (grpc.StatusCode.PERMISSION_DENIED, grpc.StatusCode.INVALID_ARGUMENT)

    @classmethod
    def start(cls, volume_section, volume="builtin:sphere:48"):
        cls.daemon = cls.enterClassContext(SecuredDaemon(f"[volume]\n{volume_section}\n", volume))
        channel = cls.daemon.channel(cls.daemon.tokens["operator"])
        cls.addClassCleanup(channel.close)
        cls.calls = PathCalls(channel)

    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix="palpate-paths-"))).resolve()

    def refusal(self, ask, path):
        with self.subTest(call=ask.__name__, path=str(path)[:80]):
            with self.assertRaises(grpc.RpcError) as refused:
                ask(str(path))
            self.assertIn(refused.exception.code(), self.REFUSALS, refused.exception.details())
            return refused.exception


class Outside(SecuredTest):
    REFUSALS = (*SecuredTest.REFUSALS, grpc.StatusCode.NOT_FOUND)

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        root = cls.root
        for name in ("load", "load/deep", "gone", "save", "outside"):
            (root / name).mkdir()
        for name in ("load/good.nrrd", "outside/secret.nrrd"):
            (root / name).write_bytes(HEADER + b"\n" + SECRET)
        for name in ("outside/secret.raw", "load/deep/voxels.raw"):
            (root / name).write_bytes(SECRET)
        for name, data_file in (("climbs", "../outside/secret.raw"), ("linked", "linked.raw"),
                                ("absolute", f"{root}/outside/secret.raw"), ("kept", "kept.raw")):
            (root / f"load/{name}.nhdr").write_bytes(HEADER + f"data file: {data_file}\n".encode())
        (root / "load/linked.raw").symlink_to("../outside/secret.raw")
        (root / "load/kept.raw").symlink_to("deep/voxels.raw")
        for kind, first in (("tif", tiff_slice()), ("dcm", b"")):
            (root / f"load/{kind}").mkdir()
            (root / f"load/{kind}/slice_1.{kind}").write_bytes(first)
            (root / f"load/{kind}/slice_2.{kind}").symlink_to("../../outside/secret.raw")
        for folder in ("load", "save"):
            (root / folder / "way_out").symlink_to(root / "outside")
            (root / folder / "link.nrrd").symlink_to("../outside/secret.nrrd")
        # Whoever starts it may lead anywhere.
        cls.start(f'load_folders = ["{root}/gone", "{root}/load"]\nsave_folders = ["{root}/save"]',
                  str(root / "load/link.nrrd"))
        (root / "gone").rmdir()  # as when a disk is taken away

    def refused_paths(self, folder):
        """That lead out of the folder, are none, or would do something to the log."""
        inside = str(self.root / folder)
        return [f"{self.root}/outside/secret.nrrd", f"{inside}/../outside/secret.nrrd",
                f"{inside}/way_out/secret.nrrd", f"{inside}/link.nrrd", "/dev/zero",
                "relative.nrrd", "", f"{inside}/good.nrrd\0.vdb", "/" + "b" * 3_000_000,
                f"{inside}/x\nforged: ready on everything", f"{inside}/\x1b[2J\rx"]

    def calls_of(self, name):
        """Of an identity of its own: how many lines each gets in the log is limited."""
        channel = self.daemon.channel(self.daemon.add_token(name, "operator"))
        self.addCleanup(channel.close)
        calls = PathCalls(channel)

        def is_known():
            try:
                return calls.felt() is not None
            except grpc.RpcError:
                return False

        self.assertTrue(wait_until(is_known))
        return calls

    def check_refused(self, method, who, ask, paths):
        """Each is refused in one short line, and is logged."""
        for path in paths:
            line = self.refusal(ask, path).details()
            self.assertTrue(0 < len(line) < 1000 and "\n" not in line, line[:200])
            # A line that repeats itself is there once.
            parts = (f"{method} of token {who} at ipv4:127.0.0.1:", f"failed: {line}")
            self.assertTrue(wait_until(lambda: any(all(part in said for part in parts)
                                                   for said in self.daemon.said)), parts)

    def test_every_call_refuses_what_is_outside(self):
        root, load, save = self.root, self.root / "load", self.root / "save"
        before = tree(save), tree(root / "outside"), self.calls.felt()
        more = {"LoadVolume": [f"{load}/climbs.nhdr", f"{load}/absolute.nhdr"],
                "LoadSeries": [f"{root}/outside/*.nrrd", f"{load}/way_out/*",
                               f"{load}/../*/secret.nrrd"]}
        for folder, names in (("load", self.calls.loads), ("save", self.calls.saves)):
            for name in names:
                calls = self.calls_of(name)
                self.check_refused(name.partition("-")[0], name,
                                   {**calls.loads, **calls.saves}[name],
                                   self.refused_paths(folder) + more.get(name, []))
        self.assertEqual((tree(save), tree(root / "outside"), self.calls.felt()), before)
        self.assertLess(max(map(len, self.daemon.said)), 3000)
        self.assertFalse([line for line in self.daemon.said
                          if line.startswith("forged") or "\x1b" in line])

    def test_links_beside_what_is_loaded(self):
        # The source may be loaded; what it leads to may not.
        for source, link in (("linked.nhdr", "linked.raw"), ("tif", "slice_2.tif"),
                             ("tif/slice_1.tif", "slice_2.tif"), ("dcm", "slice_2.dcm")):
            refusal = self.refusal(self.calls.load, self.root / "load" / source)
            self.assertEqual(refusal.code(), grpc.StatusCode.PERMISSION_DENIED, source)
            for named in (link, "volume.load_folders"):
                self.assertIn(named, refusal.details())

    def test_what_may_be_loaded_and_saved_still_may(self):
        self.calls.load(str(self.root / "load/deep/../good.nrrd"))
        self.calls.load(str(self.root / "load/kept.nhdr"))  # a link that stays below the folder
        self.calls.save(str(self.root / "save/ours.vdb"))


class OwnFiles(SecuredTest):
    """The daemon's own files, whatever its lists allow, and by whatever name."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.start('load_folders = ["/"]\nsave_folders = ["/"]')
        daemon, pid = cls.daemon, cls.daemon.process.pid
        state = daemon.folder / "state"
        # Its session comes a moment after its start.
        if not wait_until(lambda: list(state.rglob("*.toml"))):
            raise AssertionError("no session is stored")
        lasting = [daemon.key, daemon.certificate, daemon.token_file, daemon.config,
                   daemon.authority.ca]
        cls.own = [*lasting, pathlib.Path(daemon.socket + ".tls/pair.pem"), *state.rglob("*.toml")]
        cls.lasting = {path: path.read_bytes() for path in lasting}
        cls.names = list(cls.own)
        for number, path in enumerate(cls.own):
            name = cls.root / f"other-{number}.raw"
            # palpated makes the others anew now and then: a hard link would be to an old one.
            os.link(path, name) if path in lasting else name.symlink_to(path)
            header = cls.root / f"detached-{number}.nhdr"
            header.write_text("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 10\n"
                              f"spacings: 1 1 1\nencoding: raw\ndata file: {name.name}\n")
            cls.names += [name, header]
        cls.names += [f"/proc/{name}" for name in (
            "self/environ", f"{pid}/environ", f"{pid}/cmdline", f"{pid}/maps", "version",
            f"{pid}/root{daemon.key}")]
        cls.names += [f"/proc/{pid}/fd/{fd}" for fd in os.listdir(f"/proc/{pid}/fd")
                      if os.readlink(f"/proc/{pid}/fd/{fd}").startswith("/")]

    def test_they_are_not_loaded(self):
        for name in self.names:
            is_header = str(name).endswith(".nhdr")
            asks = [self.calls.load] if is_header else self.calls.loads.values()
            for ask in asks:
                self.assertNotIn("bytes", self.refusal(ask, name).details())

    def test_they_are_not_written_over(self):
        for name in [*self.own, self.daemon.folder / "state/sessions/new.nrrd"]:
            for ask in self.calls.saves.values():
                self.refusal(ask, name)
        for path, content in self.lasting.items():
            self.assertEqual(path.read_bytes(), content, path)


class Defaults(unittest.TestCase):
    def test_clients_reach_the_folder_that_it_was_started_in(self):
        root = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-own-")))
        (root / "palpated.toml").write_text("")
        daemon = self.enterContext(Daemon(more=["--config", str(root / "palpated.toml")]))
        for path in (root / "outside.nrrd", daemon.folder / "inside.nrrd"):
            path.write_bytes(HEADER + b"\n" + SECRET)
        with palpate.connect(daemon.socket) as conn:
            conn.volume.load(daemon.folder / "inside.nrrd")
            for load in (conn.volume.load, conn.recording.start):
                with self.assertRaisesRegex(palpate.PermissionDenied, str(daemon.folder)):
                    load(str(root / "outside.nrrd"))


if __name__ == "__main__":
    unittest.main()
