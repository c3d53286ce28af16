"""The installed client library, as a program outside of the tree uses it: installed
into a folder of its own, found by CMake, linked, and run against a real palpated.

Usage: sdk_install_test.py BUILD SOURCE CMAKE CXX_COMPILER"""

import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

from support import Daemon

BUILD, SOURCE, CMAKE, COMPILER = sys.argv[1:5]


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True,
                          timeout=500, check=False)


class Install(unittest.TestCase):
    def must(self, *command):
        done = run(*command)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def test_example_builds_and_runs_against_the_installed_library(self):
        folder = pathlib.Path(self.enterContext(
            tempfile.TemporaryDirectory(prefix="palpate-test-")))
        prefix = folder / "prefix"
        self.must(CMAKE, "--install", BUILD, "--component", "palpate-client", "--prefix", prefix)
        headers = sorted(prefix.rglob("*.h"))
        self.assertGreater(len(headers), 10)
        for header in headers:
            self.assertNotRegex(header.read_text(), r"#\s*include\s*[<\"](grpc|google/|palpate/v1/)")
        for config in prefix.rglob("*.cmake"):
            for tree in (BUILD, SOURCE):
                self.assertNotIn(tree, config.read_text(), f"{config} names {tree}")

        program = folder / "build"
        self.must(CMAKE, "-S", f"{SOURCE}/client/sdk/example", "-B", program,
                  f"-DCMAKE_PREFIX_PATH={prefix}", f"-DCMAKE_CXX_COMPILER={COMPILER}")
        self.must(CMAKE, "--build", program)

        missing = run(program / "example", folder / "palpated.sock")
        self.assertEqual(missing.returncode, 1)
        self.assertIn("no palpated at", missing.stderr)
        with Daemon("builtin:bumps:32") as daemon:
            said = self.must(program / "example", daemon.socket, "0.4")
        self.assertRegex(said, re.compile(r"^tick \d+: tip at .* mm, .* N$", re.MULTILINE))
        self.assertRegex(said, r"isovalue 0\.4 from tick \d+ on")


if __name__ == "__main__":
    sys.exit(unittest.main(argv=sys.argv[:1], verbosity=1))
