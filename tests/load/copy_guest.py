"""A guest that copies a volume as fast as a script can, over one connection: logs in, waits for a
manifest, and fetches the overview and all groups that the manifest names.

Says "ready", and reads a line: the gateway's port, and the time (CLOCK_MONOTONIC, s) from which it
counts. Prints JSON: seconds until it was in, had a manifest, had a whole copy; bytes; how often a
group was gone (the copy goes on with the newest manifest then); the manifest's content hash, and the
hash of its copy. With --poses: how old the poses were while it copied, and afterwards [ms]."""

import argparse
import base64
import json
import pathlib
import socket
import subprocess
import sys
import time

import numpy as np
import xxhash
import zstandard

from gateway import VOXEL_TYPES, Gateway, Guest
from support import PATIENCE_S, wait_until

CONTENT_HASH = pathlib.Path(__file__).parent.parent / "web" / "content_hash.py"
AT_ONCE = 64


class Elsewhere:
    """A gateway that another process started."""

    ask, origin = Gateway.ask, Gateway.origin

    def __init__(self, port, room):
        self.port, self.room = port, room


class PoseAges(Guest):
    """Keeps the age of each pose when it comes, by CLOCK_MONOTONIC [ms]."""

    def __init__(self, *arguments):
        self.ages = []
        super().__init__(*arguments)

    def _hear(self, kind, message):
        before = self.poses
        super()._hear(kind, message)
        if self.poses > before:
            self.ages.append(1e3 * time.monotonic() - 1e-6 * self.pose.pose.time_ns)


class Blobs:
    """One connection, on which requests go ahead of their answers."""

    def __init__(self, guest):
        self._head = (f" HTTP/1.1\r\nHost: localhost:{guest.gateway.port}\r\nCookie: {guest.cookie}"
                      "\r\nAccept-Encoding: zstd\r\n\r\n")
        self._socket = socket.create_connection(("127.0.0.1", guest.gateway.port), PATIENCE_S)
        self._file = self._socket.makefile("rb", 1 << 20)
        self._unpack = zstandard.ZstdDecompressor()
        self.bytes = 0

    def fetch(self, names):
        """(name, bytes) of each, in order; none: it is gone."""
        for begin in range(0, len(names), AT_ONCE):
            part = names[begin:begin + AT_ONCE]
            self._socket.sendall("".join(f"GET /volume/{name}{self._head}"
                                         for name in part).encode())
            for name in part:
                yield name, self._answer(name)

    def _answer(self, name):
        status = int(self._file.readline().split()[1])
        headers = {}
        while line := self._file.readline().strip():
            key, _, value = line.decode().partition(": ")
            headers[key.lower()] = value
        body = self._file.read(int(headers["content-length"]))
        self.bytes += len(body)
        if status == 410:
            return None
        if status != 200:
            raise RuntimeError(f"{name}: {status} {body!r}")
        return self._unpack.decompress(body) if headers.get("content-encoding") == "zstd" else body


def names_of(manifest):
    groups = base64.b64decode(manifest["groups"])
    return [groups[at:at + 16].hex() for at in range(0, len(groups), 16)]


def copy(guest, blobs):
    """(manifest, groups by name, how often one was gone)."""
    groups, gone = {}, 0
    while True:
        name = guest.topics["manifest"]["name"]
        (_, text), = blobs.fetch([name])
        if text is not None:
            manifest = json.loads(text)
            missing = sorted({*names_of(manifest), manifest["overview"]["name"]}
                             - {"00" * 16} - set(groups))
            found = dict(blobs.fetch(missing))
            groups |= {key: value for key, value in found.items() if value is not None}
            if None not in found.values():
                return manifest, groups, gone
        gone += 1


def hash_of_copy(manifest, groups):
    """By code that shares nothing with the product, from groups that are what their names say."""
    lattice = manifest["lattice"]
    dtype = np.dtype(lattice["voxel_type"]).newbyteorder("<")
    kind = bytes([VOXEL_TYPES.index(lattice["voxel_type"])])
    size = lattice["size"]
    count = [-(-axis // 32) for axis in size]
    whole = np.full([32 * axis for axis in count], lattice["background"], dtype)
    for name, place in zip(names_of(manifest), np.ndindex(*count)):
        if name in groups:
            if xxhash.xxh3_128_hexdigest(kind + groups[name]) != name:
                raise AssertionError(f"{name}: other bytes")
            whole[tuple(slice(32 * at, 32 * at + 32) for at in place)] = np.frombuffer(
                groups[name], dtype).reshape(32, 32, 32)
    whole = np.ascontiguousarray(whole[tuple(map(slice, size))])
    return subprocess.run(
        [sys.executable, CONTENT_HASH, lattice["voxel_type"], *map(str, size)],
        input=whole.tobytes(), capture_output=True, check=True).stdout.decode().strip()


class CopyGuest:
    """This program, for others. wrapper: a command that runs it. It is ready when this is made, so
    that its own start takes none of the time."""

    def __init__(self, secret, poses, patience=PATIENCE_S, wrapper=()):
        self._process = subprocess.Popen(
            [*wrapper, sys.executable, __file__, secret, "--poses", str(poses), "--patience",
             str(patience)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._process.stdout.readline()

    def go(self, port, began_s):
        self._process.stdin.write(f"{port} {began_s}\n")
        self._process.stdin.flush()

    def figures(self):
        said, _ = self._process.communicate()
        if not said:
            raise RuntimeError("the guest failed")
        return json.loads(said)


def run(options):
    print("ready", flush=True)
    port, began = sys.stdin.readline().split()
    began = float(began)
    gateway = Elsewhere(int(port), options.secret)
    while True:
        try:
            guest = PoseAges(gateway)
            break
        except OSError:  # it is starting
            if time.monotonic() > began + PATIENCE_S:
                raise
            time.sleep(0.02)
    joined = time.monotonic()
    if not wait_until(lambda: "manifest" in guest.topics, options.patience):
        raise RuntimeError(f"no manifest: {guest.topics}")
    told = time.monotonic()
    blobs = Blobs(guest)
    manifest, groups, gone = copy(guest, blobs)
    copied = time.monotonic()
    ages_meanwhile = list(guest.ages)
    found = {"joined_s": joined - began, "manifest_s": told - began, "copy_s": copied - began,
             "bytes": blobs.bytes, "gone": gone, "revision": manifest["revision"],
             "content_hash": manifest["content_hash"]}
    if options.poses:
        guest.ages.clear()
        time.sleep(options.poses)
        found |= {"age_ms": percentiles(guest.ages),
                  "age_while_copying_ms": percentiles(ages_meanwhile)}
    guest.close()
    found["copy_hash"] = hash_of_copy(manifest, groups)
    print(json.dumps(found), flush=True)
    return 0 if found["copy_hash"] == found["content_hash"] else 1


def percentiles(values):
    ordered = sorted(values)
    if not ordered:
        return None
    return {name: round(ordered[int(share * (len(ordered) - 1))], 1) for name, share in
            (("p50", 0.5), ("p99", 0.99), ("worst", 1.0))} | {"count": len(ordered)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("secret", help="the room's key")
    parser.add_argument("--poses", type=float, default=0.0, help="seconds of poses after the copy")
    parser.add_argument("--patience", type=float, default=PATIENCE_S,
                        help="seconds to the first manifest")
    return run(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
