"""vdb_tool judges the .vdb files of sparse_volume_test: here it is shown what it must notice."""

import pathlib
import tempfile
import unittest

import numpy as np

from vdb_support import vdb_tool, vdb_json, vdb_make, vdb_values

COMPARABLE = ("sphere", "cloud", "dense-cloud", "negative", "uint8", "int16", "int32-large",
              "double", "half", "bool", "vector", "empty", "frustum")
# What is changed, and how many voxels, and nodes, differ then.
CHANGES = {"value": (1, 0), "inactive-value": (1, 0), "state": (1, 0), "tile-value": (8**3, 0),
           "tile-state": (8**3, 0), "large-tile-value": (128**3, 0),
           "large-tile-state": (128**3, 0), "topology": (0, 1), "root-tile": (4096**3, 0),
           # The values of what lies outside of all nodes, and of no tile.
           "background": (0, 0), "metadata": (0, 0), "metadata-type": (0, 0),
           "metadata-gone": (0, 0), "metadata-new": (0, 0), "name": (0, 0), "class": (0, 0),
           "transform": (0, 0), "transform-turn": (0, 0)}
UNNOTICED = ("nothing", "metadata-ours")


class VdbTool(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def compare(self, a, b, *options):
        """(equal or not, what was said)"""
        ran = vdb_tool("compare", a, b, *options, expected=(0, 1))
        self.assertEqual(ran.stdout.count("\n"), 1, ran.stdout)
        self.assertEqual(ran.returncode == 0, ran.stdout == "equal\n")
        return ran.returncode == 0, ran.stdout

    def test_every_kind_is_equal_to_itself_and_to_no_other(self):
        for kind in COMPARABLE:
            a = vdb_make(kind, self.folder / "a.vdb")
            b = vdb_make(kind, self.folder / "b.vdb")
            self.assertEqual(self.compare(a, b), (True, "equal\n"), kind)
            if kind not in ("sphere", "vector", "empty"):
                vdb_make(kind, b, seed=2)
                self.assertFalse(self.compare(a, b)[0], kind)

    def test_one_change_is_noticed(self):
        whole = vdb_make("dense-cloud", self.folder / "a.vdb")
        changed = self.folder / "b.vdb"
        for what, expected in CHANGES.items():
            vdb_tool("change", what, whole, changed)
            for files in ((whole, changed), (changed, whole)):
                same, said = self.compare(*files)
                self.assertFalse(same, what)
                self.assertGreater(len(said), 10, what)
            found = vdb_json("diff", whole, changed)
            self.assertEqual((found["voxels"], found["nodes"]), expected, what)
        for what in UNNOTICED:
            vdb_tool("change", what, whole, changed)
            self.assertTrue(self.compare(whole, changed)[0], what)

    def test_what_our_daemon_adds_is_fine_on_one_side_only(self):
        whole = vdb_make("cloud", self.folder / "a.vdb")
        vdb_tool("change", "metadata-ours", whole, self.folder / "b.vdb")
        self.assertTrue(self.compare(whole, self.folder / "b.vdb")[0])
        self.assertFalse(self.compare(self.folder / "b.vdb", whole)[0])

    def test_rounding_is_allowed_where_asked_for_and_no_more(self):
        for kind in ("double", "int32-large"):
            a = vdb_make(kind, self.folder / "a.vdb")
            b = vdb_make(kind, self.folder / "b.vdb", seed=2)
            self.assertTrue(self.compare(a, a, "--rounded")[0])
            self.assertFalse(self.compare(a, b, "--rounded")[0])

    def test_grids_are_found_by_name(self):
        two = vdb_make("two", self.folder / "two.vdb")
        for name, kind in (("density", "cloud"), ("surface", "sphere"), ("velocity", "vector")):
            alone = vdb_make(kind, self.folder / "alone.vdb")
            self.assertTrue(self.compare(two, alone, "--grid", name)[0], name)
        vdb_tool("compare", two, two, expected=(2,))
        vdb_tool("compare", two, two, "--grid", "nonsense", expected=(2,))

    def test_values_of_a_sphere_are_distances(self):
        sphere = vdb_make("sphere", self.folder / "a.vdb")
        center, radius = np.array((3.3, -5.7, 23.9)), 28.8
        box = np.array(vdb_json("usage", sphere)["box"])
        self.assertTrue((box[0] < 0).all())
        random = np.random.default_rng(3)
        places = random.integers(box[0] - 9, box[1] + 9, (2000, 3))
        said = vdb_values(sphere, places)
        distance_mm = 0.5 * (np.linalg.norm(places - center, axis=1) - radius)
        values = np.array([value for value, _ in said], dtype=float)
        active = np.array([state == "on" for _, state in said])
        np.testing.assert_allclose(values, distance_mm.clip(-1.5, 1.5), atol=1e-4)
        beyond_mm = np.abs(distance_mm) - 1.5
        clear = np.abs(beyond_mm) > 1e-3
        np.testing.assert_array_equal(active[clear], beyond_mm[clear] < 0)
        first = vdb_tool("value", sphere, *places[0]).stdout.split()
        self.assertEqual(first, list(said[0]))

    def test_damage_is_of_many_kinds_and_the_same_for_a_seed(self):
        whole = vdb_make("cloud", self.folder / "a.vdb")
        out, seen = self.folder / "b.vdb", set()
        for seed in range(50):
            vdb_tool("fuzz", whole, seed, out)
            seen.add(out.read_bytes())
        self.assertGreater(len(seen), 45)
        self.assertGreater(len(set(map(len, seen))), 3)
        vdb_tool("fuzz", whole, 49, out)
        self.assertIn(out.read_bytes(), seen)


if __name__ == "__main__":
    unittest.main()
