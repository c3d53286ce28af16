#!/usr/bin/python3
"""Feels a volume along a spiral with the simulated hand, and plots the forces.

Needs a running palpated with the simulated device, and python3-matplotlib:

    python3 client/python/examples/feel_spiral.py --out spiral.png

The spiral is seen along the volume's z axis. The hand comes from the side of the last slice, and is
led a little below the surface.
"""

import argparse
import pathlib
import sys

import matplotlib
import numpy as np
import numpy.typing as npt

import palpate

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402: the backend comes first

Array = npt.NDArray[np.float64]

NEAR_VOXELS = 12
STEEP_VOXELS = 10.0


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--address", help="socket or HOST:PORT of palpated [its usual socket]")
    parser.add_argument("--profile", help="profile of clients.toml, instead of the address")
    parser.add_argument("--turns", type=float, default=9.0, help="of the spiral [9]")
    parser.add_argument("--seconds", type=float, default=40.0, help="for the spiral, s [40]")
    parser.add_argument("--press", dest="press_mm", type=float, default=1.0,
                        help="how far below the surface the hand is led, mm of the device [1]")
    parser.add_argument("--out", default="spiral.png", help="picture to write [spiral.png]")
    parser.add_argument("--overwrite", action="store_true",
                        help="replace a picture that is there")
    return parser.parse_args()


def heights(volume: palpate.Volume, isovalue: float) -> Array:
    """(x, y): the last z at which there is material; -1 where there is none. In voxels."""
    is_material = volume.values >= isovalue
    from_top = is_material[:, :, ::-1].argmax(axis=2)
    top = volume.shape[2] - 1 - from_top
    return np.where(is_material.any(axis=2), top, -1).astype(np.float64)


def touch(along: Array, seen: Array, over: Array, press: float) -> Array:
    """(n,): z for the hand along the way, in voxels, which `along` counts as well.

    The hand stays `press` below the surface, but passes over all that stands near where there is a
    gap or a steep side: behind either, the surface could hold it. It goes up and down at 45 degrees
    at most.
    """
    z = np.where(seen >= over - STEEP_VOXELS, seen - press, over + STEEP_VOXELS / 2.0)
    down = np.maximum.accumulate(z + along) - along
    up = np.maximum.accumulate((z - along)[::-1])[::-1] + along
    return np.maximum(down, up)


def greatest_near(seen: Array) -> Array:
    """(x, y): the greatest height within a square around each place."""
    edge = 2 * NEAR_VOXELS + 1
    padded = np.pad(seen, NEAR_VOXELS, constant_values=-1.0)
    return np.lib.stride_tricks.sliding_window_view(padded, (edge, edge)).max(axis=(2, 3))


def around(start: Array, to: Array, shape: tuple[int, ...]) -> Array:
    """(4, 3): from a place beside the volume to one above it, and down to `to`. In voxels.

    Straight on, the volume would be in the hand's way.
    """
    middle = (np.array(shape) - 1.0) / 2.0
    away = (start - middle)[:2]
    beside = np.r_[middle[:2] + away / np.linalg.norm(away) * max(shape), start[2]]
    high = np.array([0.0, 0.0, 1.5 * shape[2]])
    return np.array([start, beside, beside * [1, 1, 0] + high, to * [1, 1, 0] + high])


def spiral(shape: tuple[int, ...], turns: float, points: int) -> Array:
    """(points, 2) from the middle to the border, at even speed. In voxels."""
    share = np.sqrt(np.linspace(0.0, 1.0, points))
    angle = 2.0 * np.pi * turns * share
    middle = (np.array(shape[:2]) - 1.0) / 2.0
    return middle + 0.9 * middle.min() * (share * [np.cos(angle), np.sin(angle)]).T


def to_device_mm(voxels: Array, place_of: Array) -> Array:
    return (np.c_[voxels, np.ones(len(voxels))] @ place_of.T)[:, :3]


def to_voxels(device_mm: Array, place_of: Array) -> Array:
    return to_device_mm(device_mm, np.linalg.inv(place_of))


def plot(felt: palpate.Poses, place_of: Array, seen: Array, out: str) -> None:
    force_n = np.linalg.norm(felt.force_n, axis=1)
    hip_voxels = to_voxels(felt.hip_mm, place_of)[:, :2]
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.4), width_ratios=(1, 1.25))
    left.imshow(seen.T, cmap="gray", origin="lower")
    points = left.scatter(*hip_voxels[::10].T, c=force_n[::10], s=2, cmap="inferno")
    left.set_xlabel("x / voxels")
    left.set_ylabel("y / voxels")
    figure.colorbar(points, ax=left, label="|force| / N")
    right.plot((felt.time_ns - felt.time_ns[0]) / 1e9, force_n, linewidth=0.6)
    right.set_xlabel("time / s")
    right.set_ylabel("|force| / N")
    figure.tight_layout()
    figure.savefig(out, dpi=110)


def main() -> None:
    arguments = parse_arguments()
    if pathlib.Path(arguments.out).exists() and not arguments.overwrite:
        sys.exit(f"{arguments.out} is there already: name another one, or add --overwrite")
    with palpate.connect(arguments.address, profile=arguments.profile) as conn:
        volume = conn.volume.download()
        place_of = conn.volume.info().device_from_index
        seen = heights(volume, conn.settings.isovalue)
        x, y = spiral(volume.shape, arguments.turns, int(100 * arguments.seconds)).T
        along = np.r_[0.0, np.hypot(np.diff(x), np.diff(y)).cumsum()]
        press = arguments.press_mm / np.linalg.norm(place_of[:3, 2])
        at = x.round().astype(int), y.round().astype(int)
        z = touch(along, seen[at], greatest_near(seen)[at], press)
        with conn.device.lead() as hand, conn.poses() as stream:
            start = to_voxels(next(stream).hip_mm, place_of)[0]
            way = around(start, np.array([x[0], y[0], z[0]]), volume.shape)
            hand.follow(to_device_mm(way, place_of), rate_hz=1)
            felt = hand.follow(to_device_mm(np.c_[x, y, z], place_of), rate_hz=100)
    plot(felt, place_of, seen, arguments.out)
    print(f"felt {felt.contact.mean():.0%} of the way, at most "
          f"{np.linalg.norm(felt.force_n, axis=1).max():.2f} N; wrote {arguments.out}")


if __name__ == "__main__":
    main()
