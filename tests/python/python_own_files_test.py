"""Palpated's own files are no volumes, whatever its lists allow, by whatever name; and what is put
in a file's place after it was looked at is not read."""

import os
import pathlib
import tempfile
import threading
import time
import unittest

import grpc

import palpate
from excuse import busy_machine_may_explain
from free_port import free_port
from palpate.v1 import (recording_pb2, recording_pb2_grpc, series_pb2, series_pb2_grpc, volume_pb2,
                        volume_pb2_grpc)
from secured import SecuredDaemon
from support import Daemon

CALL_S = 60.0


class OwnFiles(unittest.TestCase):
    """All may be loaded and saved to, by the lists."""

    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix="palpate-own-"))).resolve()
        (cls.root / "security").mkdir()
        cls.daemon = cls.enterClassContext(SecuredDaemon(cls.root / "security", """
[volume]
load_folders = ["/"]
save_folders = ["/"]
"""))
        # The last ones are made anew by palpated now and then: a hard link would be to an old one.
        lasting = [cls.daemon.key, cls.daemon.certificate, cls.daemon.token_file,
                   cls.daemon.config, cls.daemon.authority.ca]
        # Its session comes a moment after its start.
        end = time.monotonic() + CALL_S
        while not list((cls.daemon.folder / "state").rglob("*.toml")) and time.monotonic() < end:
            time.sleep(0.05)
        cls.own = [*lasting, pathlib.Path(cls.daemon.socket + ".tls/pair.pem"),
                   *(path for path in (cls.daemon.folder / "state").rglob("*.toml"))]
        assert len(cls.own) > 6
        cls.names = list(cls.own)
        for number, path in enumerate(cls.own):
            cls.names.append(cls.root / f"other-{number}.raw")
            if path in lasting:
                os.link(path, cls.names[-1])
            else:
                cls.names[-1].symlink_to(path)
        pid = cls.daemon.process.pid
        cls.names += [f"/proc/{name}" for name in ("self/environ", f"{pid}/environ",
                                                   f"{pid}/cmdline", f"{pid}/maps", "version")]
        cls.names.append(f"/proc/{pid}/root{cls.daemon.key}")
        cls.names += [f"/proc/{pid}/fd/{fd}" for fd in os.listdir(f"/proc/{pid}/fd")
                      if os.readlink(f"/proc/{pid}/fd/{fd}").startswith("/")]
        channel = cls.daemon.channel(cls.daemon.tokens["operator"])
        cls.addClassCleanup(channel.close)
        cls.volume = volume_pb2_grpc.VolumeServiceStub(channel)
        cls.series = series_pb2_grpc.SeriesServiceStub(channel)
        cls.recording = recording_pb2_grpc.RecordingServiceStub(channel)

    def refused(self, path, ask, *arguments):
        with self.subTest(path=str(path)), self.assertRaises(grpc.RpcError) as refused:
            list(ask(*arguments, timeout=CALL_S))
        error = refused.exception
        self.assertIn(error.code(), (grpc.StatusCode.PERMISSION_DENIED,
                                     grpc.StatusCode.INVALID_ARGUMENT), error.details())
        self.assertNotIn("bytes", error.details())

    def raw(self, path):
        request = volume_pb2.LoadVolumeRequest(source=str(path))
        # As many bytes as any of them has at least.
        request.raw.size_x, request.raw.size_y, request.raw.size_z = 2, 2, 10
        request.raw.type = volume_pb2.VOXEL_TYPE_UINT8
        return request

    def test_as_raw_voxels(self):
        for path in self.names:
            self.refused(path, self.volume.LoadVolume, self.raw(path))

    def test_as_voxels_of_a_header(self):
        for number, path in enumerate(self.own):
            header = self.root / f"detached-{number}.nhdr"
            header.write_text("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 10\n"
                              "spacings: 1 1 1\nencoding: raw\n"
                              f"data file: other-{number}.raw\n")
            self.refused(path, self.volume.LoadVolume,
                         volume_pb2.LoadVolumeRequest(source=str(header)))

    def test_as_series(self):
        for path in self.names:
            request = series_pb2.LoadSeriesRequest(sources=[str(path)])
            request.options.raw.CopyFrom(self.raw(path).raw)
            self.refused(path, self.series.LoadSeries, request)

    def test_as_recordings(self):
        for path in self.names:
            self.refused(path, self.recording.Replay, recording_pb2.ReplayRequest(path=str(path)))

    def test_written_over(self):
        def start(request, timeout):
            return [self.recording.StartRecording(request, timeout=timeout)]
        before = [path.read_bytes() for path in self.own[:5]]
        for path in [*self.own, self.daemon.folder / "state/sessions/new.nrrd"]:
            self.refused(path, start,
                         recording_pb2.StartRecordingRequest(path=str(path), overwrite=True))
            self.refused(path, self.volume.SaveVolume,
                         volume_pb2.SaveVolumeRequest(path=str(path), overwrite=True))
        self.assertEqual([path.read_bytes() for path in self.own[:5]], before)


class Races(unittest.TestCase):
    def test_a_link_in_place_of_a_file_that_was_looked_at(self):
        with tempfile.TemporaryDirectory(prefix="palpate-race-") as folder:
            root = pathlib.Path(folder).resolve()
            (root / "load").mkdir()
            (root / "secret.raw").write_bytes(bytes([1, 2]) * 256)
            config = root / "palpated.toml"
            config.write_text(f'[volume]\nload_folders = ["{root}/load"]\n')
            victim, stop = root / "load/a.raw", threading.Event()

            def put(link):
                beside = root / f"load/beside-{link}"
                beside.unlink(missing_ok=True)
                if link:
                    beside.symlink_to(root / "secret.raw")
                else:
                    beside.write_bytes(bytes([100, 200]) * 256)
                beside.rename(victim)

            def swap():
                number = 0
                while not stop.is_set():
                    number += 1
                    put(number % 2 == 1)
                    time.sleep(0.001 * (number * 7 % 11))

            put(False)
            swapper = threading.Thread(target=swap)
            swapper.start()
            loaded = 0
            try:
                with Daemon(more=["--config", str(config)]) as daemon, \
                        grpc.insecure_channel("unix:" + daemon.socket) as channel:
                    request = volume_pb2.LoadVolumeRequest(source=str(victim))
                    request.raw.size_x = request.raw.size_y = request.raw.size_z = 8
                    request.raw.type = volume_pb2.VOXEL_TYPE_UINT8
                    for _ in range(200):
                        try:
                            *_, last = volume_pb2_grpc.VolumeServiceStub(channel).LoadVolume(
                                request, timeout=CALL_S)
                        except grpc.RpcError:
                            continue
                        self.assertEqual(last.result.volume.value_max, 200.0)
                        loaded += 1
            finally:
                stop.set()
                swapper.join()
            with busy_machine_may_explain():
                self.assertGreater(loaded, 0)


class Defaults(unittest.TestCase):
    """What nobody configured."""

    def test_clients_reach_the_folder_that_it_was_started_in_and_loopback_only_watches(self):
        root = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(prefix="palpate-own-")))
        config = root / "palpated.toml"
        config.write_text("")
        volume = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nspacings: 1 1 1\n" \
                 b"encoding: raw\n\nabcdefgh"
        (root / "outside.nrrd").write_bytes(volume)
        port = free_port()
        daemon = self.enterContext(Daemon(listen=f"127.0.0.1:{port}",
                                          more=["--config", str(config)]))
        (daemon.folder / "inside.nrrd").write_bytes(volume)
        with palpate.connect(daemon.socket) as conn:
            conn.volume.load(str(daemon.folder / "inside.nrrd"))
            for load in (conn.volume.load, conn.recording.start):
                with self.assertRaisesRegex(palpate.PermissionDenied, str(daemon.folder)):
                    load(str(root / "outside.nrrd"))
        with palpate.connect(f"127.0.0.1:{port}") as conn:
            next(iter(conn.poses()))
            with self.assertRaisesRegex(palpate.PermissionDenied, "needs the role editor"):
                conn.settings.stiffness_n_per_mm = 0.1
            with self.assertRaisesRegex(palpate.PermissionDenied, "needs the role operator"):
                conn.volume.load(str(daemon.folder / "inside.nrrd"))


if __name__ == "__main__":
    unittest.main()
