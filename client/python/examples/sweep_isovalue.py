#!/usr/bin/python3
"""Sweeps the isovalue over the volume's range and plots the force against time.

Needs a running palpated and python3-matplotlib:

    python3 client/python/examples/sweep_isovalue.py --out sweep.png
"""

import argparse
import pathlib
import sys

import matplotlib
import numpy as np

import palpate

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402: the backend comes first


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--address", help="socket or HOST:PORT of palpated [its usual socket]")
    parser.add_argument("--profile", help="profile of clients.toml, instead of the address")
    parser.add_argument("--from", dest="first", type=float, default=0.2,
                        help="normalised isovalue to begin with [0.2]")
    parser.add_argument("--to", dest="last", type=float, default=0.8, help="to end with [0.8]")
    parser.add_argument("--steps", type=int, default=13, help="number of isovalues [13]")
    parser.add_argument("--seconds", type=float, default=2.0, help="at each of them, s [2]")
    parser.add_argument("--out", default="sweep.png", help="picture to write [sweep.png]")
    parser.add_argument("--overwrite", action="store_true",
                        help="replace a picture that is there")
    return parser.parse_args()


def felt_at(conn: palpate.Connection, normalized: float, seconds: float) -> palpate.Poses:
    """Sets the isovalue and returns the poses of the seconds after it has arrived."""
    conn.settings.normalized_isovalue = normalized
    isovalue = conn.settings.isovalue
    batches: list[palpate.Poses] = []
    # Many batches may wait, because every sample is needed.
    with conn.poses(rate_hz=1000, batch=50, waiting=100) as stream:
        for poses in stream:
            # Under a stylus that touches, the isovalue takes a moment.
            if batches or poses.isovalue[0] == isovalue:
                batches.append(poses)
            if batches and (poses.time_ns[-1] - batches[0].time_ns[0]) / 1e9 >= seconds:
                return palpate.Poses.concatenate(batches)
    raise AssertionError("a stream of poses has no end")


def plot(felt: palpate.Poses, unit: str, out: str) -> None:
    """Plots force and isovalue against time, one above the other."""
    seconds = (felt.time_ns - felt.time_ns[0]) / 1e9
    figure, (above, below) = pyplot.subplots(2, sharex=True, figsize=(9, 5),
                                             height_ratios=(3, 1))
    above.plot(seconds, np.linalg.norm(felt.force_n, axis=1), linewidth=0.7)
    above.set_ylabel("|force| / N")
    below.step(seconds, felt.isovalue, where="post")
    below.set_ylabel(f"isovalue / {unit}" if unit else "isovalue")
    below.set_xlabel("time / s")
    figure.tight_layout()
    figure.savefig(out, dpi=120)


def main() -> None:
    arguments = parse_arguments()
    if pathlib.Path(arguments.out).exists() and not arguments.overwrite:
        sys.exit(f"{arguments.out} is there already: name another one, or add --overwrite")
    steps = []
    with palpate.connect(arguments.address, profile=arguments.profile) as conn:
        before = conn.settings.isovalue
        try:
            for normalized in np.linspace(arguments.first, arguments.last, arguments.steps):
                felt = felt_at(conn, float(normalized), arguments.seconds)
                steps.append(felt)
                force_n = np.linalg.norm(felt.force_n, axis=1)
                print(f"isovalue {felt.isovalue[-1]:.6g}: mean |force| {force_n.mean():.3f} N, "
                      f"in contact {felt.contact.mean():.0%}")
        finally:
            conn.settings.isovalue = before
        plot(palpate.Poses.concatenate(steps), conn.volume.info().unit, arguments.out)
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
