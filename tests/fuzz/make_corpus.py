#!/usr/bin/env python3
"""make_corpus.py FOLDER: writes the corpora of the fuzz targets, inputs from which a fuzzer starts,
named for what they are. Written against the description of the formats, not with our code. An input
that once broke something belongs here, too."""

import pathlib
import random
import shutil
import struct
import sys

sys.dont_write_bytecode = True  # the folder is the repository's
import corpus_devices
import corpus_images
import corpus_recordings
import corpus_state


def handovers():
    """Bytes to lay over a dense hand-over (0) or a tree (1): by hand, and anywhere."""
    yield "handover_fuzz", "dense", b"\0\x08\0\x04abcd"
    yield "handover_fuzz", "tree", b"\x01\x10\0\x04\x02\0\0\0"
    choose = random.Random(7)
    for number in range(120):
        overlays = b""
        for _ in range(choose.randint(1, 4)):
            # From the start, where all depends on each number, or from the voxels on.
            place = choose.choice((2 * choose.randrange(160), choose.randrange(16000)))
            overlays += struct.pack("<HB", place, 1) + choose.randbytes(1)
        yield "handover_fuzz", f"any_bytes_{number}", bytes([number % 2]) + overlays


def main(folder):
    shutil.rmtree(folder, ignore_errors=True)
    sources = [source.corpora() for source in
               (corpus_devices, corpus_images, corpus_recordings, corpus_state)]
    for corpora in [handovers(), *sources]:
        for target, name, data in corpora:
            (folder / target).mkdir(parents=True, exist_ok=True)
            (folder / target / name).write_bytes(data)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
