"""What tests of .vdb files through the real daemon share. OpenVDB alone, in vdb_tool, writes the
files and judges them."""

import pathlib
import subprocess
import tempfile

import numpy as np

import palpate
from support import PALPATE, PATIENCE_S, DaemonTest
from vdb_support import vdb_json, vdb_leaves, vdb_make, vdb_tool, vdb_values

INVALID = 3
# Of vdb_tool's sphere of 64 voxels' edge: centre, voxels and mm; radius, mm.
CENTER = np.array((3.3, -5.7, 23.9))
SPHERE_MM = 0.5
RADIUS_MM = 14.4


def command(daemon, *arguments):
    return subprocess.run([PALPATE, *map(str, arguments), "--socket", daemon.socket],
                          capture_output=True, text=True, timeout=5 * PATIENCE_S, check=False)


def poses_until(conn, holds, batches=200):
    """Samples, 500 in a second, until holds(all of them) or there are so many batches of 100."""
    samples = []
    with conn.poses(rate_hz=500, batch=100, waiting=100) as stream:
        for poses in stream:
            samples.append(poses)
            both = palpate.Poses.concatenate(samples)
            if holds(both) or len(samples) == batches:
                return both


class SparseTest(DaemonTest):
    volume = "builtin:sphere:16"

    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(
            tempfile.TemporaryDirectory(dir=self.daemon.folder)))

    def make(self, kind, **options):
        return vdb_make(kind, self.folder / f"{kind}.vdb", **options)

    def palpate(self, *arguments):
        """What a command that must succeed said."""
        ran = command(self.daemon, *arguments)
        self.assertEqual(ran.returncode, 0, f"palpate {arguments}: {ran.stderr}")
        return ran

    def load(self, path, *options):
        return self.palpate("load", path, *options)

    def saved(self, name="saved.vdb"):
        """The path of a file that the daemon has written."""
        path = self.folder / name
        self.palpate("save", path, "--overwrite")
        return path

    def require_equal(self, a, b, *options):
        ran = vdb_tool("compare", a, b, *options, expected=(0, 1))
        self.assertEqual(ran.stdout, "equal\n")

    def require_refused(self, path, parts, *options, codes=(INVALID,)):
        """One clear line, which holds these parts; what was felt stays."""
        before = self.conn.volume.info()
        ran = command(self.daemon, "load", path, *options)
        self.assertIn(ran.returncode, codes, ran.stderr)
        refusals = [line for line in ran.stderr.splitlines() if line.startswith("palpate: ")]
        self.assertEqual(len(refusals), 1, ran.stderr)
        for part in parts:
            self.assertIn(part, refusals[0])
        after = self.conn.volume.info()
        self.assertEqual((after.source, after.volume_revision),
                         (before.source, before.volume_revision))

    def require_voxels(self, path, value_of=float, *options):
        """Random voxels that are felt have the file's values, at the file's places in the world."""
        info, felt = self.conn.volume.info(), self.conn.volume.download().values
        box = np.array(vdb_json("usage", path, *options)["box"])
        first = self.first_index(info, path, *options)
        for end in (box[0] - first, box[1] - first):
            self.assertTrue((end >= 0).all() and (end < felt.shape).all(),
                            f"{box} is not in {felt.shape} from {first} on")
        random = np.random.default_rng(2)
        # Leaves, too: of a sparse box they are a small part.
        leaves = random.choice(vdb_leaves(path, *options), 5000) + random.integers(0, 8, (5000, 3))
        places = np.concatenate([random.integers(box[0], box[1] + 1, (5000, 3)), leaves])
        places = places[((places >= box[0]) & (places <= box[1])).all(axis=1)]
        expected = np.array([value_of(value) for value, _ in vdb_values(path, places, *options)],
                            dtype=np.float32)
        np.testing.assert_array_equal(felt[tuple((places - first).T)], expected)

    def first_index(self, info, path, *options):
        """The file's index of the first voxel that is felt."""
        transform = np.array(vdb_json("usage", path, *options)["world_from_index"])
        first = np.linalg.inv(transform) @ info.world_from_index[:, 3]
        np.testing.assert_allclose(first, first.round(), atol=1e-3)
        turned = np.linalg.inv(transform)[:3, :3] @ info.world_from_index[:3, :3]
        np.testing.assert_allclose(turned, np.eye(3), atol=1e-6)
        return first[:3].round().astype(int)

    def require_felt(self, radius_mm, leaves_box=False):
        """A hand from outside touches the sphere of vdb_tool, which is the volume, at this radius.
        leaves_box: the volume is so small that the hand leaves its box often."""
        info = self.conn.volume.info()
        index_from_device = np.linalg.inv(info.device_from_index)

        def index(points_mm):
            ones = np.ones((len(points_mm), 1))
            return (np.hstack([points_mm, ones]) @ index_from_device.T)[:, :3]

        def distance_mm(points_mm):
            world = np.hstack([index(points_mm), np.ones((len(points_mm), 1))]) \
                @ info.world_from_index.T
            return np.linalg.norm(world[:, :3] - SPHERE_MM * CENTER, axis=1)

        poses = self.felt(info, index, leaves_box)
        contact = poses.contact & (poses.mode == palpate.ProxyMode.CONSTRAINED)
        self.assertGreater(contact.sum(), 300)
        # V is the sphere but for what is lost between voxels; H is within its cell.
        on_v = contact & np.isfinite(poses.scp_v_mm).all(axis=1)
        self.assertGreater(on_v.sum(), 200)
        self.assertLess(abs(distance_mm(poses.scp_v_mm[on_v]) - radius_mm).max(), 0.1 * SPHERE_MM)
        self.assertLess(abs(distance_mm(poses.scp_h_mm[contact]) - radius_mm).max(),
                        0.5 * SPHERE_MM)
        # A hand that was inside when the volume came is led out first.
        felt = contact | (poses.mode == palpate.ProxyMode.FREE)
        self.assertGreater(distance_mm(poses.scp_h_mm[felt]).min(), radius_mm - 0.5 * SPHERE_MM)
        outside = self.outside(info, index(poses.scp_h_mm))
        if leaves_box:
            self.assertGreater(outside.sum(), 20)
        self.assertFalse(poses.contact[outside].any())
        self.assertTrue((poses.mode[outside] == palpate.ProxyMode.FREE).all())

    @staticmethod
    def outside(info, index):
        return ((index < 0) | (index > np.array(info.shape) - 1)).any(axis=1)

    def felt(self, info, index, leaves_box):
        """Samples of the new volume, some in contact, and some beyond its box if it is left."""
        before = self.conn.settings.update(isovalue=0.0)

        def chosen(poses):
            return Chosen(poses, (poses.volume_revision == info.volume_revision)
                          & (poses.settings_revision >= before.settings_revision))

        def enough(poses):
            of_it = chosen(poses)
            outside = self.outside(info, index(of_it.scp_h_mm)).sum()
            return of_it.contact.sum() > 500 and (outside > 50 or not leaves_box)

        return chosen(poses_until(self.conn, enough))


class Chosen:
    """Some samples of poses."""

    def __init__(self, poses, which):
        self._poses, self._which = poses, which

    def __getattr__(self, name):
        return getattr(self._poses, name)[self._which]
