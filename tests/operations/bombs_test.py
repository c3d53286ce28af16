"""Small files and calls that ask for far more memory than there is: each is refused in one line, and
the daemon never takes more than its budget and the overhead that the guides state."""

import os
import pathlib
import struct
import subprocess
import sys
import time
import unittest

import numpy as np
import zstandard

import palpate
from budget_test import BUDGET_MIB, OVERHEAD_MIB, Sampler, own_mib
from palpate.v1 import volume_pb2
from support import PATIENCE_S, SANITIZED, Client, Daemon, wait_until

sys.path.append(str(pathlib.Path(__file__).parents[1] / "fuzz"))
import corpus_recordings  # noqa: E402

HEAD = struct.Struct("<BQ")  # opcode and length
CHUNK, MESSAGE_INDEX, DATA_END = 6, 7, 15
TICK, EVENT = 0, 4  # channels


def with_markers(recording, first_tick, count, length):
    """A recording with so many texts more, behind its first chunk with ticks."""
    parts, at = [recording[:8]], 8
    while at < len(recording) - 8:
        opcode, size = HEAD.unpack_from(recording, at)
        record = recording[at:at + HEAD.size + size]
        at += len(record)
        # A checksum of 0 is none.
        parts.append(record if opcode != DATA_END else record[:HEAD.size] + bytes(4))
        if opcode != MESSAGE_INDEX or not count:
            continue
        channel, indexes = struct.unpack_from("<HI", record, HEAD.size)
        if channel == TICK:
            tick = first_tick + indexes // 16
            head = HEAD.pack(5, 22 + len(corpus_recordings.event("x" * length, tick)))
            text = head + struct.pack("<HIQQ", EVENT, 0, 1, 1) + (
                corpus_recordings.event("x" * length, tick))
            data = 1000 * text
            packed = zstandard.ZstdCompressor().compress(data)
            parts += count // 1000 * [corpus_recordings.chunk(packing="zstd", packed=packed,
                                                              size=len(data))]
            count = 0
    return b"".join(parts) + recording[-8:]


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
        path = self.daemon.folder / "texts.mcap"
        self.conn.recording.start(path)
        time.sleep(2.5)
        self.conn.recording.stop()
        first_tick = int(palpate.open_recording(path).ticks.tick[0])
        path.write_bytes(with_markers(path.read_bytes(), first_tick, 200_000, 4000))
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
