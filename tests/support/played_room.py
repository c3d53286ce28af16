"""A room on NATS whose publisher is the test: volumes and messages by the tables of the headers."""

import base64
import hashlib
import json
import pathlib
import random
import struct
import threading
import time

import numpy as np
import xxhash
import zstandard

from palpate.v1 import envelope_pb2

from gateway import VOXEL_TYPES

ROOM = "hall"
MANIFEST = 255
SLICE = 512 << 10
MACHINE = hashlib.sha256(
    pathlib.Path("/proc/sys/kernel/random/boot_id").read_bytes().strip()).hexdigest()[:32]


def hash_of(kind, data):
    return xxhash.xxh3_128_digest(bytes([kind]) + data)


def parts_of(kind, data):
    frame = zstandard.ZstdCompressor(level=1).compress(data)
    slices = [frame[at:at + SLICE] for at in range(0, len(frame), SLICE)]
    return [struct.pack("<BBHH", 1, kind, number, len(slices)) + hash_of(kind, data) + piece
            for number, piece in enumerate(slices)]


class Volume:
    """Messages of voxels whose size is whole groups; the overview is the voxels themselves, or
    `overview`."""

    def __init__(self, voxels, revision, name="made.nrrd", overview=None, with_groups=True):
        overview = voxels if overview is None else overview
        kind = VOXEL_TYPES.index(voxels.dtype.name)
        count = [axis // 32 for axis in voxels.shape]
        self.voxels, self.groups, names = voxels, [], b""
        for i, j, k in np.ndindex(*count):
            data = voxels[32 * i:32 * i + 32, 32 * j:32 * j + 32, 32 * k:32 * k + 32].tobytes()
            self.groups += parts_of(kind, data)
            names += hash_of(kind, data)
        self.overview = parts_of(kind, overview.tobytes())
        manifest = json.dumps({
            "lattice": {"size": voxels.shape, "voxel_type": voxels.dtype.name, "background": 0.0,
                        "value_min": 0.0, "value_max": 255.0, "factor": 1},
            "revision": revision, "daemon_id": "1", "content_hash": f"{revision:032x}",
            "overview": {"name": hash_of(kind, overview.tobytes()).hex(), "size": overview.shape,
                         "factor": voxels.shape[0] // overview.shape[0]},
            "groups": base64.b64encode(names).decode() if with_groups else ""}).encode()
        if not with_groups:
            self.groups = []
        self.manifest = parts_of(MANIFEST, manifest)
        self.name = hash_of(MANIFEST, manifest).hex()
        size = dict(zip(("size_x", "size_y", "size_z"), voxels.shape))
        place = {"linear": np.eye(3).ravel()}
        self.message = envelope_pb2.RoomVolume(
            facts={"volume": {"name": name, "world_from_index": place, **size},
                   "placement": {"settings_revision": revision, "device_from_index": place}},
            manifest=json.dumps({"type": "manifest", "name": self.name, "revision": revision,
                                 "complete": True})).SerializeToString()


def envelope_of(fact, members):
    """A fact as a room keeps it."""
    return envelope_pb2.Envelope(facts={fact: members}).SerializeToString()


class Publisher:
    """Makes the room's stream, and sends beats and poses until close()."""

    def __init__(self, server, protocol=2, machine=MACHINE, **user):
        self.client = server.client(**user)
        self.client.request(f"$JS.API.STREAM.CREATE.PALPATE_{ROOM}", json.dumps({
            "name": f"PALPATE_{ROOM}", "subjects": [f"palpate.{ROOM}.kept.>"],
            "storage": "memory", "retention": "limits", "max_msgs_per_subject": 1,
            "discard": "old", "max_consumers": 1, "num_replicas": 1, "allow_direct": True}))
        self._beat = {"protocol": protocol, "session": f"{random.getrandbits(64):016x}",
                      "machine": machine}
        self._hashes = {}
        self.is_silent, self._is_over, self.ticks = False, threading.Event(), 0
        self.text("connection", state="connected", why="", palpated="theatre-2", since_ms=5)
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def _live(self):
        while not self._is_over.wait(0.05):
            if self.is_silent:
                continue
            try:
                if self.ticks % 10 == 0:
                    self.live("beat", json.dumps(self._beat | {"kept": self._kept()}))
                self.live("pose", self.pose(self.ticks))
                self.ticks += 1
            except OSError:
                return

    @staticmethod
    def pose(tick, age_ms=2.0):
        sent_ms = 1e3 * time.clock_gettime(time.CLOCK_MONOTONIC)
        there = {name: {} for name in ("scp_h_mm", "stylus_orientation", "force_n", "forces")}
        return envelope_pb2.Envelope(
            sequence=9, sent_ms=sent_ms, age_ms=age_ms, fresh=True,
            pose={"tick": tick, "time_ns": int(1e6 * (sent_ms - age_ms)), "isovalue": 0.5,
                  "hip_mm": {"x": 1, "y": 2, "z": 3}, **there}).SerializeToString()

    def live(self, subject, data):
        self.client.publish(f"palpate.{ROOM}.live.{subject}", data)

    def keep(self, subject, data):
        subject = f"palpate.{ROOM}.kept.{subject}"
        self.client.publish(subject, data)
        if subject.rpartition(".")[0].endswith((".kept", ".text")):
            data = data.encode() if isinstance(data, str) else data
            self._hashes[subject] = hash_of(1, subject.encode() + b"\0" + data)

    def _kept(self):
        return {subject.rpartition(".")[2]: digest.hex()
                for subject, digest in list(self._hashes.items())}

    def text(self, topic, **members):
        self.keep(f"text.{topic}", json.dumps({"type": topic} | members))

    def fact(self, name, members):
        self.keep(f"text.{name}", envelope_of(name, members))

    def settings(self, revision):
        self.fact("settings", {"settings_revision": revision})

    def show(self, volume):
        for kind, parts in (("group", volume.groups), ("overview", volume.overview),
                            ("manifest", volume.manifest)):
            for number, part in enumerate(parts):
                self.keep(f"{kind}.{number}", part)
        self.keep("volume", volume.message)
        self.client.flush()

    def close(self):
        self._is_over.set()
        self._thread.join()
        self.client.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def noise(seed, size=(64, 32, 64)):
    return np.random.default_rng(seed).integers(0, 256, size, np.uint8)
