""".vdb files through the real daemon: what was loaded is felt, edited and saved as it was, in the
memory that OpenVDB itself takes. OpenVDB alone, in vdb_tool, writes the files and judges them."""

import concurrent.futures
import json
import os
import pathlib
import subprocess
import tempfile
import unittest

import numpy as np

import palpate
from crash import found_by_a_sanitizer
from support import PALPATED, PATIENCE_S, Daemon, wait_until
from sparse_support import INVALID, RADIUS_MM, SparseTest, poses_until
from vdb_support import vdb_json, vdb_tool, vdb_values

IMPORT = pathlib.Path(PALPATED).with_name("palpate-import")
# AddressSanitizer keeps what was freed for a while: its builds say nothing about memory.
SANITIZED = "PALPATE_SANITIZED" in os.environ
TORTURE = "PALPATE_TORTURE" in os.environ
MIB = 1 << 20
USAGE, TOO_LARGE = 2, 6
EXACT = ("sphere", "cloud", "dense-cloud", "negative", "uint8", "int16", "half", "bool")
# The daemon's values are floats: these may come back rounded to float, if the load says so.
ROUNDED = ("double", "int32-large")


class Saving(SparseTest):
    def check_kind(self, kind):
        path = self.make(kind)
        said = self.load(path)
        self.require_voxels(path)
        if kind in EXACT:
            self.assertNotIn("warning", said.stderr)
            return self.require_equal(path, self.saved())
        ran = vdb_tool("compare", path, self.saved(), expected=(0, 1))
        if ran.returncode != 0:
            self.assertIn("round", said.stderr)
            self.require_equal(path, self.folder / "saved.vdb", "--rounded")
        return None

    def test_every_kind_of_scalars_is_saved_as_it_was(self):
        for kind in EXACT + ROUNDED:
            with self.subTest(kind):
                self.check_kind(kind)

    def test_a_saved_file_is_loaded_and_saved_again(self):
        path = self.make("cloud")
        self.load(path)
        again = self.saved("first.vdb")
        self.load(again)
        self.require_equal(path, self.saved("second.vdb"))

    def test_a_volume_of_another_format_is_saved_as_before(self):
        # A box of voxels, in the file's only grid.
        self.palpate("load", "builtin:sphere:40")
        usage = vdb_json("usage", self.saved())
        self.assertEqual((usage["name"], usage["type"]), ("density", "float"))
        values = self.conn.volume.download().values
        places = np.random.default_rng(1).integers(0, 40, (3000, 3))
        saved = [float(value) for value, _ in vdb_values(self.folder / "saved.vdb", places)]
        np.testing.assert_array_equal(np.array(saved, dtype=np.float32), values[tuple(places.T)])


class Choosing(SparseTest):
    """Files of several grids, and of vectors."""

    def test_several_grids_are_listed_and_one_is_named(self):
        path = self.make("two")
        self.require_refused(path, ["density", "surface", "--grid NAME"])
        self.require_refused(path, ["density", "surface", "nonsense"], "--grid", "nonsense")
        for name in ("surface", "density"):
            self.load(path, "--grid", name)
            self.require_voxels(path, float, "--grid", name)
            self.require_equal(path, self.saved(), "--grid", name)

    def test_grids_of_the_same_name_are_refused(self):
        self.require_refused(self.make("same-names"), ["density"])

    def test_a_grid_of_vectors_wants_a_component(self):
        both, alone = self.make("two"), self.make("vector")
        wanted = ["velocity", "--component", "magnitude, x, y or z"]
        self.require_refused(both, wanted, "--grid", "velocity")
        self.require_refused(alone, wanted)
        self.require_refused(alone, ["magnitude, x, y or z"], "--component", "w",
                             codes=(INVALID, USAGE))
        vectors = {"x": 0, "y": 1, "z": 2}
        for name, axis in vectors.items():
            self.load(both, "--grid", "velocity", "--component", name)
            self.require_voxels(both, lambda text, n=axis: parsed(text)[n], "--grid", "velocity")
        self.load(alone, "--component", "x")
        self.require_voxels(alone, lambda text: parsed(text)[0])

    def test_a_magnitude_is_the_length(self):
        path = self.make("vector")
        self.load(path, "--component", "magnitude")
        info, felt = self.conn.volume.info(), self.conn.volume.download().values
        first = self.first_index(info, path)
        places = np.random.default_rng(4).integers(first, first + felt.shape, (3000, 3))
        lengths = [np.linalg.norm(parsed(text)) for text, _ in vdb_values(path, places)]
        np.testing.assert_allclose(felt[tuple((places - first).T)], lengths, rtol=1e-6)

    def test_what_has_nothing_to_feel_is_refused(self):
        for kind, part in (("empty", "active"), ("points", "scalar"), ("frustum", "linear")):
            with self.subTest(kind):
                self.require_refused(self.make(kind), [part])


def parsed(text):
    """The vector "[x, y, z]"."""
    return np.array(text.strip("[]").split(","), dtype=float)


class Feeling(SparseTest):
    def setUp(self):
        super().setUp()
        # The next load takes back what a load changed by itself; what a client has set may stay.
        self.conn.settings.update(free_side="below")

    def settings(self):
        return json.loads(self.palpate("settings", "--json").stdout)

    def test_a_level_set_starts_at_its_surface_and_is_free_outside(self):
        density = self.make("cloud")
        self.load(self.make("sphere"))
        settings = self.settings()
        self.assertEqual((settings["isovalue"], settings["free_side"]), (0.0, "above"))
        self.load(density)
        settings = self.settings()
        self.assertEqual(settings["free_side"], "below")
        self.assertGreater(settings["isovalue"], 0.0)
        # What is asked for wins.
        self.load(self.make("sphere"), "--isovalue", "0.5")
        self.assertEqual(self.settings()["isovalue"], 0.5)

    def test_a_level_set_that_is_replaced_by_another_format_is_free_below_again(self):
        self.load(self.make("sphere"))
        self.assertEqual(self.settings()["free_side"], "above")
        self.palpate("load", "builtin:sphere:48")
        self.assertEqual(self.settings()["free_side"], "below")

    def test_a_hand_from_outside_touches_a_sphere_at_its_radius(self):
        # Small enough that the hand leaves its box often.
        self.load(self.make("sphere"), "--device-mm-per-volume-mm", "1.2")
        self.conn.settings.update(isovalue=0.0, free_side="above")
        self.require_felt(RADIUS_MM, leaves_box=True)


class Editing(SparseTest):
    def edit(self, center_mm, radius_mm, value):
        said = self.palpate("edit", "sphere", "--center-mm", ",".join(map(repr, center_mm)),
                            "--radius-mm", radius_mm, "--operation", "add", "--value", value,
                            "--json")
        return json.loads(said.stdout)

    def check_edit(self, path, center, radius, value):
        """An edit about a voxel of the file: exactly the voxels within the radius differ."""
        self.load(path)
        transform = np.array(vdb_json("usage", path)["world_from_index"])
        center_mm = (transform @ (*center, 1.0))[:3].tolist()
        spacing_mm = np.linalg.norm(transform[:3, 0])
        said = self.edit(center_mm, radius * spacing_mm, value)
        edge = np.arange(-int(radius) - 3, int(radius) + 4)
        around = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), -1).reshape(-1, 3)
        within = np.linalg.norm(around, axis=1) <= radius
        self.assertEqual(said["changed_voxels"], within.sum())
        edited = self.saved("edited.vdb")
        found = vdb_json("diff", path, edited)
        changed = around[within] + center
        self.assertEqual(found["voxels"], within.sum())
        self.assertEqual(found["box"], [changed.min(axis=0).tolist(), changed.max(axis=0).tolist()])
        before, after = (np.array([v for v, _ in vdb_values(p, around + center)], dtype=np.float32)
                         for p in (path, edited))
        np.testing.assert_array_equal(
            after, np.where(within, before + np.float32(value), before))
        self.palpate("undo")
        self.require_equal(path, self.saved("undone.vdb"))
        self.palpate("redo")
        self.require_equal(edited, self.saved("redone.vdb"))
        self.palpate("revert")
        self.require_equal(path, self.saved("reverted.vdb"))

    def test_of_a_level_set_at_its_surface(self):
        # Where no value reaches the ends of the range. The radius is that of no voxel.
        self.check_edit(self.make("sphere"), (32, -6, 24), 2.1, 0.125)

    def test_of_a_cloud_in_an_active_tile(self):
        path = self.make("cloud")
        # vdb_tool's tile of 128 voxels of 0.375.
        place = np.array(vdb_json("usage", path)["box"])[0] + (40, 300, 40)
        self.assertEqual(vdb_values(path, [place]), [("0.375", "on")])
        self.check_edit(path, tuple(place), 4.1, 0.125)

    def test_of_a_cloud_where_nothing_was(self):
        path = self.make("cloud")
        box = np.array(vdb_json("usage", path)["box"])
        places = np.random.default_rng(7).integers(box[0] + 8, box[1] - 8, (400, 3))
        offsets = np.array([(x, y, z) for x in (-4, 0, 4) for y in (-4, 0, 4) for z in (-4, 0, 4)])
        around = (places[:, None] + offsets).reshape(-1, 3)
        values = np.array([float(v) for v, _ in vdb_values(path, around)]).reshape(-1, len(offsets))
        empty = places[(values == 0.0).all(axis=1)]
        self.assertGreater(len(empty), 10)
        self.check_edit(path, tuple(empty[0]), 3.2, 0.25)


def status_kib(process, key):
    for line in pathlib.Path(f"/proc/{process.pid}/status").read_text().splitlines():
        if line.startswith(key + ":"):
            return int(line.split()[1])
    raise AssertionError(f"no {key}")


def mappings(process):
    return len(pathlib.Path(f"/proc/{process.pid}/maps").read_text().splitlines())


class Configured(SparseTest):
    """A daemon whose memory is not locked: that would count what is reserved, too."""

    budget_mib = None

    @classmethod
    def setUpClass(cls):
        folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        budget = f"memory_budget_mib = {cls.budget_mib}\n" if cls.budget_mib else ""
        (folder / "palpated.toml").write_text('[realtime]\nlock_memory = false\n[volume]\n'
                                              f'load_folders = ["/"]\n{budget}')
        cls.daemon = cls.enterClassContext(
            Daemon(cls.volume, more=["--config", str(folder / "palpated.toml")]))
        cls.conn = cls.enterClassContext(cls.daemon.connect())


class Memory(Configured):
    """What a sparse file of this edge costs the daemon. A subclass has a daemon of its own: what
    another volume left behind would hide a part."""

    edge = 2048 if TORTURE else 512

    def check_memory(self, path, grid_bytes, *options):
        before_kib = status_kib(self.daemon.process, "VmRSS")
        most = 1.3 * grid_bytes + (0 if TORTURE else 8 * MIB)

        def taken():
            return 1024 * (status_kib(self.daemon.process, "VmRSS") - before_kib)

        # The second one frees the first, on a thread that nobody waits for.
        for _ in range(2):
            self.load(path, *options)
            wait_until(lambda: taken() <= most)
            more = taken()
            peak = 1024 * (status_kib(self.daemon.process, "VmHWM") - before_kib)
            print(f"{path.name}: {grid_bytes / MIB:.1f} MiB in OpenVDB; {more / grid_bytes:.3f} "
                  f"times as much in the daemon, {peak / grid_bytes:.3f} at the peak")
            if not SANITIZED:
                self.assertLessEqual(more, most)

    def check_felt(self, revision):
        poses = poses_until(self.conn, lambda p: (p.contact
                                                  & (p.volume_revision == revision)).sum() > 50)
        self.assertGreater((poses.contact & (poses.volume_revision == revision)).sum(), 50)

    def check_edited_and_saved(self, path):
        middle = ",".join(str(n // 2) for n in self.conn.volume.info().shape)
        said = json.loads(self.palpate(
            "edit", "sphere", "--center-voxels", middle,
            "--radius-voxels", "6.3", "--operation", "paint", "--value", "0.3", "--strength",
            "0.5", "--json").stdout)
        self.assertGreater(said["changed_voxels"], 900)
        found = vdb_json("diff", path, self.saved())
        self.assertEqual(found["voxels"], said["changed_voxels"])
        self.palpate("undo")
        self.require_equal(path, self.saved())

    def check(self, kind, *options):
        path = self.make(kind, edge=self.edge)
        self.check_memory(path, vdb_json("usage", path)["bytes"], *options)
        self.check_felt(self.conn.volume.info().volume_revision)
        self.check_edited_and_saved(path)


class NarrowBand(Memory):
    def test_a_sphere_costs_what_it_costs_in_openvdb(self):
        self.check("sphere", "--isovalue", "0")


class Scattered(Memory):
    def test_a_cloud_costs_what_it_costs_in_openvdb(self):
        # A tile of 128 voxels' edge is above it.
        self.check("cloud", "--isovalue", "0.3")


class Damaged(Configured):
    """Damaged files: each is a volume or a refusal of one line, and the daemon stays as it was."""

    budget_mib = 256
    kinds = ("cloud", "sphere", "negative", "uint8", "bool", "two")

    def try_load(self, path):
        """Whether it was loaded."""
        before = self.conn.volume.info().volume_revision
        try:
            self.conn.volume.load(path)
        except palpate.Error as error:
            self.assertIsInstance(error, (palpate.InvalidArgument, palpate.TooLarge,
                                          palpate.Internal))
            if isinstance(error, palpate.Internal):
                self.assertIn("crashed", str(error))
            self.assertNotIn("\n", str(error))
            self.assertIn(path.name, str(error))
            self.assertEqual(self.conn.volume.info().volume_revision, before)
            return False
        return True

    def importers(self):
        tasks = pathlib.Path(f"/proc/{self.daemon.process.pid}/task")
        return [child for file in tasks.glob("*/children") for child in file.read_text().split()]

    def test_damaged_files_leave_the_daemon_as_it_was(self):
        process = self.daemon.process
        base_kib = status_kib(process, "VmRSS")
        seeds = [self.make(kind) for kind in self.kinds]
        self.load(seeds[0])
        warm_kib, warm_mappings = status_kib(process, "VmRSS"), mappings(process)
        loaded, refused, damaged = 0, 0, self.folder / "damaged.vdb"
        for number in range(60):
            vdb_tool("fuzz", seeds[number % len(seeds)], number, damaged)
            if self.try_load(damaged):
                loaded += 1
            else:
                refused += 1
            self.assertIsNone(process.poll(), "the daemon has ended")
            if not SANITIZED:
                self.assertLess(status_kib(process, "VmRSS") - base_kib,
                                1024 * (self.budget_mib + 32))
        print(f"{loaded} loaded, {refused} refused")
        self.assertGreater(refused, 10)
        self.assertTrue(wait_until(lambda: not self.importers()))
        self.load(seeds[0])
        if not SANITIZED:
            print(f"{warm_kib} KiB before, {status_kib(process, 'VmRSS')} after; {warm_mappings} "
                  f"mappings before, {mappings(process)} after")
            self.assertLess(status_kib(process, "VmRSS"), 1.2 * warm_kib + 16 * 1024)
            self.assertLess(mappings(process), warm_mappings + 60)
        self.require_equal(seeds[0], self.saved())

    @unittest.skipUnless("PALPATE_FUZZ_RUNS" in os.environ, "the long form: PALPATE_FUZZ_RUNS")
    def test_many_damaged_files_through_the_importer(self):
        runs = min(int(os.environ["PALPATE_FUZZ_RUNS"]), 100_000)
        seeds = [self.make(kind, edge=24) for kind in self.kinds]

        def run(number):
            damaged, output = (self.folder / f"{number}{end}.vdb" for end in ("", "-out"))
            vdb_tool("fuzz", seeds[number % len(seeds)], number, damaged)
            ran = subprocess.run([IMPORT, damaged, output, "--max-memory-mib", "512"],
                                 capture_output=True, text=True, timeout=PATIENCE_S, check=False)
            written = output.exists()
            damaged.unlink()
            output.unlink(missing_ok=True)
            return number, ran, written

        codes = {}
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            for number, ran, written in pool.map(run, range(runs)):
                self.check_import(number, ran, written)
                codes[ran.returncode] = codes.get(ran.returncode, 0) + 1
        print(codes)
        self.assertGreater(codes.get(INVALID, 0), runs // 10)

    def check_import(self, number, ran, written):
        said = f"{number}: {ran.returncode} {ran.stderr}"
        lines = [line for line in ran.stderr.splitlines() if not line.startswith("warning")]
        if SANITIZED and "requested allocation size" in ran.stderr:
            return  # new throws elsewhere: AddressSanitizer ends the program
        self.assertFalse(found_by_a_sanitizer(ran.stderr), said)
        self.assertIn(ran.returncode, (0, 1, INVALID, TOO_LARGE), said)
        if ran.returncode == 1:
            self.assertIn("the reader crashed", ran.stderr, said)
        self.assertEqual(written, ran.returncode == 0, said)
        self.assertEqual(len(lines), 0 if ran.returncode == 0 else 1, said)


if __name__ == "__main__":
    unittest.main()
