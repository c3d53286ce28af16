"""A new setting is written in one place: a copy of the sources gets a field in render.proto, and
everything that users see has it then. Prints a line for each place."""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PYTHON = "/usr/bin/python3"  # Debian's, for its protobuf
KEY = "tremor_force_n"
FIELD = f"""
  // Of the scratch test.
  optional double {KEY} = 90 [(setting) = {{
    label: "Tremor"
    help: "how strongly the surface trembles"
    unit: "N" minimum: 0 maximum: 2.5 default_number: 0.25
  }}];
"""


def run(*command, **options):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True,
                          check=False, **options)
    if done.returncode != 0:
        raise AssertionError(f"{command}: {done.returncode}\n{done.stdout}\n{done.stderr}")
    return done.stdout


def say(place, what):
    print(f"{place + ':':<21}{what}", flush=True)


class ScratchTest(unittest.TestCase):
    """A copy of the sources with one setting more: what the generator writes there, with one small
    program of it."""

    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix="palpate-scratch-")))
        ignored = shutil.ignore_patterns("build*", ".git", "__pycache__", "*.egg-info")
        for part in ("proto", "client", "common", "server/haptics", "deploy/config",
                     "deploy/guides", "deploy/tools", "tests/support"):
            shutil.copytree(ROOT / part, cls.root / part, ignore=ignored, dirs_exist_ok=True)
        # The one place.
        contract = cls.root / "proto/palpate/v1/render.proto"
        head, begin, tail = contract.read_text().partition("message RenderSettings {\n")
        body, end, rest = tail.partition("\n}\n")
        contract.write_text(head + begin + body + FIELD + end.lstrip("\n") + rest)
        # The one command.
        run(cls.root / "proto/generate/update.py")

    def line_of(self, name, start):
        found = [line for line in (self.root / name).read_text().splitlines()
                 if line.startswith(start)]
        self.assertEqual(len(found), 1, found)
        return found[0]

    def test_files_that_people_read(self):
        line = self.line_of("deploy/config/palpated.toml", KEY)
        self.assertEqual(line, f"{KEY} = 0.25")
        text = (self.root / "deploy/config/palpated.toml").read_text()
        self.assertIn(f"# How strongly the surface trembles. Of the scratch test.\n# 0 to 2.5 N\n"
                      f"{line}\n", text)
        say("palpated.toml", line)
        line = self.line_of("deploy/guides/settings.md", f"| `{KEY}`")
        self.assertEqual(line, f"| `{KEY}` | N | 0 to 2.5 | 0.25 | how strongly the surface "
                               "trembles. Of the scratch test. |")
        say("table of the guide", line)

    def test_programs(self):
        probe = self.root / "probe"
        run("c++", "-std=c++20", "-O0", "-Wall", "-Wextra", "-Werror", "-I", self.root, "-isystem", "/usr/include/eigen3", "-o", probe,
            *(self.root / source for source in (
                "tests/support/setting_probe.cpp", "client/cli/setting.cpp",
                "client/view/palpated/setting_change.cpp")), "-lfmt")
        said = dict(line.split(": ", 1) for line in run(probe, KEY).splitlines())
        self.assertEqual(said["daemon's check"], f"{KEY} from 0 to 2.5 N, 0.25 at first")
        self.assertEqual(said["palpate set"], "tremor_force 1.25; give 0 to 2.5 N")
        self.assertEqual(said["palpate settings"], "tremor_force 0.25 N")
        self.assertIn("tremor_force", said["completion list"].split())
        self.assertEqual(said["viewer's panel"], "slider 'Tremor' from 0 to 2.5, '%.2f N'")
        for place, what in said.items():
            say(place, what)

    def test_python(self):
        built = self.root / "python-built"
        run(PYTHON, "-W", "ignore", "setup.py", "-q", "build_py", "--no-compile", "--build-lib",
            built, cwd=self.root / "client/python")
        about = run(PYTHON, "-c", f"import inspect, palpate\n"
                    f"print(inspect.getdoc(palpate.Settings.{KEY}))",
                    env=os.environ | {"PYTHONPATH": str(built)}).strip()
        self.assertEqual(about, "How strongly the surface trembles. Of the scratch test.\n"
                                "0 to 2.5 N; default 0.25")
        say("attribute in Python", f"settings.{KEY}: {about.splitlines()[1]}")


if __name__ == "__main__":
    sys.exit(unittest.main(verbosity=1))
