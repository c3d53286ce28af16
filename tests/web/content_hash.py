"""Prints the content hash of voxels as palpated computes it: content_hash.py TYPE I J K < voxels,
the last axis fastest; all axes are multiples of 8. The page's copy is judged by it, without code
of the page."""

import sys

import numpy as np
import xxhash

EDGE = 8


def main() -> None:
    shape = tuple(int(text) for text in sys.argv[2:5])
    voxels = np.frombuffer(sys.stdin.buffer.read(), sys.argv[1]).reshape(shape).astype("<f4")
    counts = [n // EDGE for n in shape]
    high = low = number = 0
    for a in range(counts[0]):
        for b in range(counts[1]):
            for c in range(counts[2]):
                brick = voxels[a * 8 : a * 8 + 8, b * 8 : b * 8 + 8, c * 8 : c * 8 + 8]
                digest = xxhash.xxh3_128_intdigest(np.ascontiguousarray(brick).tobytes(), number)
                high += digest >> 64
                low += digest & (2**64 - 1)
                number += 1
    print(f"{high % 2**64:016x}{low % 2**64:016x}")


main()
