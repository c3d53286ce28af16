"""Small files and calls that ask for far more memory than there is: each is refused in one line, and
the daemon never takes more than its budget and the overhead that the guides state."""

import io
import os
import pathlib
import struct
import subprocess
import time
import unittest

import numpy as np
import xxhash
import zstandard

import palpate
from budget_test import BUDGET_MIB, OVERHEAD_MIB, Sampler, own_mib
from palpate._recording_frame import Kind, read_header
from palpate.v1 import volume_pb2
from support import PATIENCE_S, SANITIZED, Client, Daemon, wait_until

CHUNK = struct.Struct("<QHHII")  # after the checksum


def chunk(number, kind, raw_bytes, packed):
    rest = CHUNK.pack(number, kind, 0, raw_bytes, len(packed)) + packed
    return struct.pack("<Q", xxhash.xxh3_64_intdigest(rest)) + rest


def with_markers(recording, count, length):
    """A recording with so many texts more, all one second after its start."""
    stream = io.BytesIO(recording)
    time_ns = read_header(stream, "recording").created_monotonic_ns + 1_000_000_000
    at = stream.tell()
    parts, number, tick = [recording[:at]], 0, None
    while at < len(recording):
        _, kind, _, raw_bytes, stored_bytes = CHUNK.unpack_from(recording, at + 8)
        packed = recording[at + 28:at + 28 + stored_bytes]
        at += 28 + stored_bytes
        parts.append(chunk(number, kind, raw_bytes, packed))
        number += 1
        if kind not in (Kind.SCENE, Kind.SAMPLES):
            continue
        unpacked = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
        if kind == Kind.SCENE and tick is None:
            tick = struct.unpack_from("<Q", unpacked)[0]
        if kind == Kind.SAMPLES and count:
            tick += struct.unpack_from("<I", unpacked)[0]
            payload = struct.pack("<QqI", tick, time_ns, length) + b"x" * length
            marker = zstandard.ZstdCompressor().compress(payload)
            parts += [chunk(number + n, Kind.MARKER, len(payload), marker) for n in range(count)]
            number, count = number + count, 0
    return b"".join(parts)


@unittest.skipIf(SANITIZED, "the sanitizers keep what was freed")
class Bombs(unittest.TestCase):
    def setUp(self):
        config = {"volume": [f"memory_budget_mib = {BUDGET_MIB}"],
                  "realtime": ["lock_memory = false"]}
        self.daemon = self.enterContext(Daemon("builtin:sphere:16", config=config))
        self.conn = self.enterContext(self.daemon.connect())
        time.sleep(1.0)
        self.idle_mib = own_mib(self.daemon.pid)
        self.before = self.conn.volume.info().volume_revision
        self.sampler = Sampler(self.daemon.pid)
        self.addCleanup(self.sampler.worker.stop)

    def judge(self):
        self.assertLessEqual(self.sampler.most_mib, BUDGET_MIB + self.idle_mib + OVERHEAD_MIB)
        self.assertEqual(self.conn.volume.info().volume_revision, self.before)
        print(f"{self.id().rpartition('.')[2]}: at most {self.sampler.most_mib:.0f} MiB")

    def refused(self, kinds, call):
        with self.assertRaises(kinds) as caught:
            call()
        self.assertNotIn("\n", str(caught.exception))

    def test_tiles(self):
        path = self.daemon.folder / "tiles.vdb"
        subprocess.run([os.environ["PALPATE_VDB_TOOL"], "make", "tiles", "128", path], check=True)
        self.assertLess(path.stat().st_size, 20 << 20)
        self.refused(palpate.TooLarge, lambda: self.conn.volume.load(path))
        self.judge()

    def test_texts(self):
        path = self.daemon.folder / "texts.palrec"
        self.conn.recording.start(path)
        time.sleep(2.5)
        self.conn.recording.stop()
        path.write_bytes(with_markers(path.read_bytes(), 200_000, 4000))
        self.assertLess(path.stat().st_size, 30 << 20)
        texts = []

        def told(state):
            texts.append(state.marker)
            return len(texts) < 1000
        # 800 MB of texts: they are shown for as long as somebody wants to see them.
        self.refused(palpate.Cancelled,
                     lambda: self.conn.recording.replay(path, speed=10.0, progress=told))
        self.assertIn(4000, map(len, texts))
        self.judge()

    def test_frames(self):
        path = self.daemon.folder / "frames.nrrd"
        header = (b"NRRD0004\ntype: uint8\ndimension: 4\nsizes: 2 2 2 2147483647\n"
                  b"kinds: domain domain domain time\nspacings: 1 1 1 1\nencoding: raw\n\n")
        path.write_bytes(header + bytes(range(8)))  # a first frame that could be felt
        os.truncate(path, len(header) + 8 * 2147483647)  # sparse
        self.refused(palpate.TooLarge, lambda: self.conn.series.load(path))
        self.judge()

    def test_uploads_that_stand_still(self):
        start = volume_pb2.UploadVolumeRequest(start=volume_pb2.UploadVolumeStart(
            name="a.nrrd", size_bytes=(BUDGET_MIB << 20) // 5))

        def requests():
            yield start
            time.sleep(2 * PATIENCE_S)
        calls = [Client(self.daemon).volume.UploadVolume.future(requests()) for _ in range(8)]
        for call in calls:
            self.assertTrue(wait_until(call.done))
            self.assertNotIn("\n", call.exception().details())
        # Others find room again.
        self.conn.volume.upload(np.resize(np.arange(999, dtype=np.float32), (200, 200, 200)))
        self.before = self.conn.volume.info().volume_revision
        self.judge()


if __name__ == "__main__":
    unittest.main(verbosity=2)
