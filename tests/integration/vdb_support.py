"""vdb_tool from Python: .vdb files that OpenVDB alone wrote, and its judgements."""

import json
import os
import subprocess

import numpy as np

VDB_TOOL = os.environ["PALPATE_VDB_TOOL"]
PATIENCE_S = 300.0


def vdb_tool(*arguments, stdin=None, expected=(0,)):
    """What it said. AssertionError for another exit code than those expected."""
    ran = subprocess.run([VDB_TOOL, *map(str, arguments)], input=stdin, capture_output=True,
                         text=True, timeout=PATIENCE_S, check=False)
    if ran.returncode not in expected:
        raise AssertionError(f"vdb_tool {arguments}: {ran.returncode} {ran.stdout}{ran.stderr}")
    return ran


def vdb_json(*arguments):
    return json.loads(vdb_tool(*arguments).stdout)


def vdb_make(kind, path, edge=64, seed=1):
    """The path of a new file."""
    vdb_tool("make", kind, path, "--edge", edge, "--seed", seed)
    return path


def vdb_values(path, places, *options):
    """[(value, "on" or "off")] of voxels (n, 3), in the file's own indices."""
    text = "".join("%d %d %d\n" % tuple(place) for place in places)
    said = vdb_tool("values", path, *options, stdin=text).stdout
    return [tuple(line.rsplit(" ", 1)) for line in said.splitlines()]


def vdb_leaves(path, *options):
    """(n, 3): the first voxel of each leaf."""
    said = vdb_tool("leaves", path, *options).stdout.split()
    return np.array(said, dtype=int).reshape(-1, 3)
