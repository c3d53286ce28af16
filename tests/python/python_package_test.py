"""The package installs offline, is typed and documented, and its example works."""

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
import zipfile

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


def copied_source(folder):
    """client/python in a copy: pip leaves files in the tree that it builds."""
    for part in ("proto", "client/python", "deploy/tools"):
        shutil.copytree(ROOT / part, folder / "source" / part,
                        ignore=shutil.ignore_patterns("build", "*.egg-info"))
    return folder / "source/client/python"


def offline():
    """An environment without the package, without an index, and with a proxy where nothing
    listens: no network."""
    environment = {name: value for name, value in os.environ.items()
                   if name not in ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "PALPATE_SERVER")}
    return environment | {"PIP_NO_INDEX": "1", "https_proxy": "http://127.0.0.1:9"}


def examples():
    """The lines of Python in the package's README, by block."""
    return re.findall(r"```python\n(.*?)```", (PACKAGE / "README.md").read_text(), re.DOTALL)


class Wheel(unittest.TestCase):
    """It is built without a network, needs no compiler where it is installed, and the README's
    first lines run there.

    Debian's packages stand in for its dependencies: that pip finds these in an index, and that
    the messages work with a newer protobuf, is not proved here."""

    def test_it_is_built_installed_and_used(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            environment = offline()
            run([sys.executable, "-m", "pip", "wheel", "--no-build-isolation", "--no-deps",
                 "--wheel-dir", folder / "wheels", copied_source(folder)], env=environment)
            wheel, = (folder / "wheels").iterdir()
            self.assertEqual(wheel.name, "palpate-0.1.0-py3-none-any.whl")
            with zipfile.ZipFile(wheel) as archive:
                held = set(archive.namelist())
            self.assertLessEqual({"palpate/py.typed", "palpate/v1/pose_pb2.py",
                                  "palpate/v1/pose_pb2.pyi", "palpate/v1/pose_pb2_grpc.py"}, held)
            self.assertFalse([name for name in held if name.endswith((".so", ".proto"))])
            # With the packages of Debian, too.
            run([sys.executable, "-m", "venv", "--system-site-packages", folder / "venv"])
            python = folder / "venv/bin/python3"
            # Neither protoc nor a compiler is found.
            environment["PATH"] = str(python.parent)
            run([python, "-m", "pip", "install", "--no-deps", wheel], env=environment)
            script = folder / "first.py"
            script.write_text(examples()[0] + "print(palpate.__file__)\n")
            with Daemon("builtin:sphere:48") as daemon:
                said = run([python, script], cwd=folder,
                           env=environment | {"PALPATE_SOCKET": daemon.socket})
                with daemon.connect() as conn:
                    self.assertEqual(conn.volume.info().shape, (64, 64, 64))  # as its lines load
            self.assertIn(str(folder / "venv"), said)


class Readme(unittest.TestCase):
    def test_its_other_lines_run(self):
        # What names a daemon or a file that are not here, in the words of those that are.
        blocks = [block.replace("/data/head.nrrd", "builtin:sphere:64") for block in examples()[1:]
                  if "lab.example" not in block]
        self.assertEqual(len(blocks), 5)
        with Daemon() as daemon, daemon.connect() as conn:
            conn.recording.start(daemon.folder / "trial-7.mcap")
            conn.recording.mark("here")
            next(conn.poses(100, 10))
            conn.recording.stop()
            said = run([sys.executable, "-c", "import palpate\nconn = palpate.connect()\n"
                        "path_mm = [(0, 55, 0), (5, 55, 0)]\n" + "".join(blocks)], cwd=daemon.folder,
                       env=os.environ | {"PALPATE_SOCKET": daemon.socket, "PALPATE_SERVER": ""})
        self.assertIn("'here')]", said)


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

    def test_what_is_called_says_its_arguments_its_errors_and_an_example(self):
        called = [(held, "", held) for held in (palpate.connect, palpate.open_recording,
                                                palpate.profiles)]
        for held in (palpate.Connection, palpate.Device, palpate.Edits, palpate.Hand,
                     palpate.LiveVolume, palpate.PoseStream, palpate.Poses, palpate.Recording,
                     palpate.RecordingFile, palpate.RecordedEdit, palpate.RecordedTicks,
                     palpate.Series, palpate.Settings, palpate.Volume, palpate.VolumeAccess):
            called += [(getattr(held, part), inspect.getdoc(held), f"{held.__name__}.{part}")
                       for part in dir(held) if not part.startswith("_")
                       and inspect.isroutine(getattr(held, part))]
        self.assertGreater(len(called), 45)
        for function, of_class, name in called:
            said = inspect.getdoc(function)
            self.assertIn("Example", said, name)
            everything = said + of_class
            if name not in ("Connection.close", "LiveVolume.close", "PoseStream.close"):
                self.assertRegex(everything, r"Errors|errors", name)
            # Those that "as load()" and the like stand for are in that docstring.
            more = inspect.getdoc(palpate.VolumeAccess.load) if "load" in said else ""
            for argument in inspect.signature(function).parameters:
                if argument != "self":
                    self.assertIn(argument, everything + more, name)

    def test_every_field_says_what_it_is(self):
        for name in palpate.__all__:
            held = getattr(palpate, name)
            if dataclasses.is_dataclass(held) and held is not palpate.RecordedTicks:
                for field in dataclasses.fields(held):
                    if not field.name.startswith("_"):
                        self.assertRegex(inspect.getdoc(held), rf"\b{field.name}\b", name)

    def test_arrays_say_their_shapes(self):
        for held in (palpate.Poses, palpate.Volume, palpate.VolumeInfo, palpate.DeviceInfo):
            for field in dataclasses.fields(held):
                if "NDArray" in str(field.type) or "ndarray" in str(field.type):
                    self.assertRegex(inspect.getdoc(held), rf"(?m)^{field.name}: \(", held)

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
