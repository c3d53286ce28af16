"""Edits a palpated's volume: edits.py SOCKET COUNT RATE_HZ, small spheres here and there, then
undoes five."""

import sys
import time

import palpate


def main() -> None:
    socket, count, rate_hz = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    with palpate.connect(socket) as connection:
        start = time.monotonic()
        for n in range(count):
            place = (10.0 + n % 50, 60.0 - n % 47, 20.0 + n % 7)
            connection.edit.sphere(place, 6.0, "add", 0.25)
            time.sleep(max(0.0, start + (n + 1) / rate_hz - time.monotonic()))
        for _ in range(5):
            connection.edit.undo()
        print(f"{count / (time.monotonic() - start):.1f} edits/s")


main()
