"""The package installs offline, is typed and documented, and its example works."""

import ast
import dataclasses
import inspect
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import palpate
from support import Daemon

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "client/python"


def run(command, **options):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True,
                          timeout=500, **options)
    if done.returncode != 0:
        raise AssertionError(f"{command}: {done.returncode}\n{done.stdout}\n{done.stderr}")
    return done.stdout


class Installed(unittest.TestCase):
    def test_pip_installs_it_without_a_network(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            # A copy: pip leaves files in the tree that it builds.
            for part in ("proto", "client/python"):
                shutil.copytree(ROOT / part, folder / "source" / part,
                                ignore=shutil.ignore_patterns("build", "*.egg-info"))
            run([sys.executable, "-m", "venv", "--system-site-packages", folder / "venv"])
            python = folder / "venv/bin/python3"
            environment = {name: value for name, value in os.environ.items()
                           if name not in ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE")}
            # No index, and a proxy where nothing listens: no network.
            environment |= {"PIP_NO_INDEX": "1", "https_proxy": "http://127.0.0.1:9"}
            run([python, "-m", "pip", "install", "--no-build-isolation", "--no-deps",
                 folder / "source/client/python"], env=environment)
            script = ("import palpate, palpate.v1.pose_pb2, pathlib, sys\n"
                      "folder = pathlib.Path(palpate.__file__).parent\n"
                      "assert str(folder).startswith(sys.prefix), folder\n"
                      "assert (folder / 'py.typed').exists()\n"
                      "with palpate.connect(sys.argv[1]) as conn:\n"
                      "    print(len(next(conn.poses(100, 5))))\n")
            with Daemon() as daemon:
                self.assertEqual(run([python, "-c", script, daemon.socket], env=environment,
                                     cwd=folder), "5\n")


class Documented(unittest.TestCase):
    def test_what_is_public_says_what_it_is(self):
        for name in palpate.__all__:
            held = getattr(palpate, name)
            self.assertTrue(inspect.getdoc(held), name)
            if not inspect.isclass(held):
                continue
            for part, member in vars(held).items():
                if not part.startswith("_") and (callable(member) or isinstance(member, property)):
                    self.assertTrue(inspect.getdoc(member), f"{name}.{part}")

    def test_arrays_say_their_shapes(self):
        for held in (palpate.Poses, palpate.Volume, palpate.VolumeInfo, palpate.DeviceInfo):
            for field in dataclasses.fields(held):
                if "NDArray" in str(field.type) or "ndarray" in str(field.type):
                    self.assertRegex(inspect.getdoc(held), rf"(?m)^{field.name}: \(", held)

    def test_every_function_is_annotated(self):
        for path in sorted((PACKAGE / "palpate").glob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.FunctionDef):
                    where = f"{path.name}:{node.lineno} {node.name}"
                    self.assertIsNotNone(node.returns, where)
                    for argument in node.args.args + node.args.kwonlyargs:
                        if argument.arg != "self":
                            self.assertIsNotNone(argument.annotation, where)

    def test_files_and_lines_are_short(self):
        for path in sorted(PACKAGE.rglob("*.py")):
            lines = path.read_text().splitlines()
            self.assertLess(len(lines), 500, path)
            self.assertLessEqual(max(map(len, lines), default=0), 100, path)

    @unittest.skipUnless(shutil.which("mypy"), "mypy is not installed")
    def test_types_hold(self):
        built = pathlib.Path(palpate.__file__).parent
        with tempfile.TemporaryDirectory() as cache:
            said = run(["mypy", "--config-file", PACKAGE / "pyproject.toml", "--cache-dir", cache,
                        "-p", "palpate"], cwd=built.parent)
        self.assertIn("Success", said)


class Example(unittest.TestCase):
    def test_the_sweep_draws_a_picture(self):
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            self.skipTest("matplotlib is not installed")
        with Daemon() as daemon, tempfile.TemporaryDirectory() as folder:
            picture = pathlib.Path(folder) / "sweep.png"
            said = run([sys.executable, PACKAGE / "examples/sweep_isovalue.py", "--address",
                        daemon.socket, "--steps", "4", "--seconds", "0.5", "--out", picture],
                       env=os.environ | {"MPLCONFIGDIR": folder})
            self.assertEqual(len(re.findall(r"^isovalue ", said, re.MULTILINE)), 4, said)
            self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
            with daemon.connect() as conn:
                # As it was before.
                self.assertEqual(conn.settings.isovalue, 0.5)


if __name__ == "__main__":
    unittest.main()
