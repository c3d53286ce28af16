#!/usr/bin/env python3
"""Takes the guides' pictures of rigid tools: what a led hand feels with them on the CT head.

Usage: deploy/guides/tool_pictures.py FOLDER [drill|probe ...]

Runs palpated with a simulated stylus that has torque, and palpate-view without a window. Reads the
volume from PALPATE_DATA_DIR (default: ../shared/data) and programs and `palpate` from build. The
plots need python3-matplotlib.
"""

import contextlib
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import matplotlib
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "build" / "python"))
import palpate  # noqa: E402: from the build

matplotlib.use("svg")
from matplotlib import pyplot  # noqa: E402: the backend comes first

pyplot.rcParams["svg.fonttype"] = "none"  # letters as text

DATA = pathlib.Path(os.environ.get("PALPATE_DATA_DIR", ROOT.parent / "shared" / "data"))
HEAD = DATA / "paper" / "SUBST_head_ct_cranium_256x256x108_int16.nrrd"
BONE_HU = 300.0
TORQUE_N_MM = 50

# Between them lies the head; the rest is its support. In voxels.
SUPPORT = (((0, 0, 0), (50, 255, 107)), ((211, 0, 0), (255, 255, 107)), ((0, 0, 0), (255, 22, 107)))

# The volume's axes to the device's: its side with the face to the right, or its face, to the user.
FROM_SIDE = (0.5, -0.5, -0.5, -0.5)
FROM_FRONT = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


@contextlib.contextmanager
def palpated():
    """A daemon with the CT head at its own size, and its connection."""
    with tempfile.TemporaryDirectory(prefix="palpate-pictures.") as folder:
        work = pathlib.Path(folder)
        (work / "config.toml").write_text(
            f'[device]\nkind = "simulated"\ntorque_n_mm = {TORQUE_N_MM}\n'
            f'[volume]\nsource = "{HEAD}"\nisovalue = {BONE_HU}\ndevice_mm_per_volume_mm = 1\n')
        with (work / "log").open("w") as log:
            daemon = subprocess.Popen([ROOT / "build/bin/palpated", "--config", work / "config.toml",
                                       "--socket", work / "s", "--state-folder", work / "state"],
                                      stdout=log, stderr=log)
        try:
            while "ready on" not in (work / "log").read_text():
                if daemon.poll() is not None:
                    sys.exit((work / "log").read_text())
                time.sleep(0.1)
            with palpate.connect(str(work / "s")) as conn:
                for corner_min, corner_max in SUPPORT:
                    conn.edit.box(corner_min, corner_max, "set", -1024, frame="index")
                yield conn, work / "s"
        finally:
            daemon.terminate()
            daemon.wait()


def turned(axis, degrees):
    """(4,): a quaternion w, x, y, z."""
    half = math.radians(degrees) / 2
    return np.r_[math.cos(half), math.sin(half) * np.array(axis, float)]


def product(a, b):
    """(n, 4) times (4,)."""
    w, v = a[..., :1], a[..., 1:]
    return np.concatenate([w * b[0] - (v @ b[1:])[..., None],
                           w * b[1:] + b[0] * v + np.cross(v, b[1:])], axis=-1)


def turn_deg(a, b):
    """(n,): the angle between two orientations."""
    return np.degrees(2 * np.arccos(np.minimum(np.abs((a * b).sum(axis=-1)), 1)))


def plot(felt, at_rest, name, folder):
    time_s = (felt.time_ns - felt.time_ns[0])[::20] / 1e9
    figure, rows = pyplot.subplots(3, 1, figsize=(6.4, 5.2), sharex=True)
    rows[0].plot(time_s, turn_deg(felt.stylus_orientation, at_rest)[::20], label="stylus")
    rows[0].plot(time_s, turn_deg(felt.tool_orientation, at_rest)[::20], label="tool as felt")
    rows[0].set_ylabel("tilt / °")
    rows[0].legend(frameon=False)
    rows[1].plot(time_s, np.linalg.norm(felt.force_n, axis=1)[::20], color="black")
    rows[1].set_ylabel("|force| / N")
    rows[2].plot(time_s, np.linalg.norm(felt.torque_n_mm, axis=1)[::20], color="black")
    rows[2].set_ylabel("|torque| / N mm")
    rows[2].set_xlabel("time / s")
    for row in rows:
        row.spines[["top", "right"]].set_visible(False)
        row.lines[0].set_linewidth(1)
    figure.tight_layout()
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


def picture(socket, name, folder, *view):
    subprocess.run([ROOT / "build/bin/palpate-view", "--socket", socket, "--offscreen", "--overwrite",
                    "--screenshot", folder / f"{name}.png", "--no-box", *view], check=True)


def swing(hand, tip, axis, rest, most_deg):
    """Tilts the stylus to `most_deg`, holds it, and tilts it back."""
    share = np.concatenate([np.linspace(0, 1, 300), np.ones(100), np.linspace(1, 0, 300)])
    turns = np.array([product(turned(axis, most_deg * s), rest) for s in share])
    return hand.follow(np.tile(tip, (len(share), 1)), rate_hz=100, orientations=turns)


def drill(folder):
    """A bore into the temporal bone behind the ear, in which the shaft is tilted against its rim."""
    with palpated() as (conn, socket):
        conn.volume.place(rotation_wxyz=FROM_SIDE, center_mm=(25, 50, -62))
        conn.settings.update(carve_tool=True, carve_rate_per_s=2.0)
        rest = turned((1, 0, 0), -20)
        inward = -np.array([0, math.sin(math.radians(20)), math.cos(math.radians(20))])
        with conn.device.lead() as hand:
            hand.follow([(0, 0, 35)], orientations=[rest])
            conn.settings.tool = palpate.Tool.read(ROOT / "deploy/tools/drill.toml")
            conn.settings.wait_for_tool()
            way = -25 * inward + np.linspace(0, 40, 600)[:, None] * inward
            hand.follow(way, rate_hz=100, buttons=1, orientations=np.tile(rest, (600, 1)))
            tip = way[-1] - 2 * inward
            felt = swing(hand, tip, (0, 1, 0), rest, 25)
            hand.move_to(tip, orientation=product(turned((0, 1, 0), 25), rest))
            time.sleep(2)
            picture(socket, "tool-drill", folder, "--size", "720x560", "--camera", "55,30,75",
                    "--target", "0,0,5")
    plot(felt, rest, "tool-drill", folder)


def probe(folder):
    """A probe in the orbit, whose shaft is tilted against the bone's rim above it."""
    with palpated() as (conn, socket):
        conn.volume.place(rotation_wxyz=FROM_FRONT, center_mm=(32, 14, -60))
        rest = turned((1, 0, 0), 10)
        with conn.device.lead() as hand:
            hand.follow([(0, 0, 35)], orientations=[rest])
            conn.settings.tool = palpate.Tool.read(ROOT / "deploy/tools/probe.toml")
            conn.settings.wait_for_tool()
            tip = np.array([0, 0, -15])
            hand.follow(np.linspace((0, 0, 35), tip, 300), orientations=np.tile(rest, (300, 1)))
            felt = swing(hand, tip, (1, 0, 0), rest, -45)
            hand.move_to(tip, orientation=product(turned((1, 0, 0), -45), rest))
            time.sleep(2)
            picture(socket, "tool-probe", folder, "--size", "720x560", "--camera=-35,10,130",
                    "--target", "0,0,5")
    plot(felt, rest, "tool-probe", folder)


def main():
    scenes = {"drill": drill, "probe": probe}
    if len(sys.argv) < 2 or not set(sys.argv[2:]) <= set(scenes):
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[2:] or scenes:
        scenes[name](folder)


if __name__ == "__main__":
    main()
