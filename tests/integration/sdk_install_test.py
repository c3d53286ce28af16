"""The installed client library, as a program outside of the tree uses it: installed
into a folder of its own, found by CMake, linked, and run against a real palpated.

Usage: sdk_install_test.py BUILD SOURCE PALPATED CMAKE CXX_COMPILER"""

import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

BUILD, SOURCE, PALPATED, CMAKE, COMPILER = sys.argv[1:6]


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True,
                          timeout=500, check=False)


class Install(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="palpate-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def must(self, *command):
        done = run(*command)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def test_example_builds_and_runs_against_the_installed_library(self):
        prefix = self.folder / "prefix"
        self.must(CMAKE, "--install", BUILD, "--component", "palpate-client", "--prefix", prefix)
        headers = sorted(prefix.rglob("*.h"))
        self.assertGreater(len(headers), 10)
        for header in headers:
            self.assertNotRegex(header.read_text(), r"#\s*include\s*[<\"](grpc|google/|palpate/v1/)")
        for config in prefix.rglob("*.cmake"):
            for folder in (BUILD, SOURCE):
                self.assertNotIn(folder, config.read_text(), f"{config} names {folder}")

        program = self.folder / "build"
        self.must(CMAKE, "-S", f"{SOURCE}/client/sdk/example", "-B", program,
                  f"-DCMAKE_PREFIX_PATH={prefix}", f"-DCMAKE_CXX_COMPILER={COMPILER}")
        self.must(CMAKE, "--build", program)

        socket = self.folder / "palpated.sock"
        missing = run(program / "example", socket)
        self.assertEqual(missing.returncode, 1)
        self.assertIn("no palpated at", missing.stderr)
        with subprocess.Popen([PALPATED, "--volume", "builtin:bumps:32", "--socket", str(socket),
                               "--state-folder", str(self.folder / "state")],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as daemon:
            try:
                for line in daemon.stdout:
                    if "ready on" in line:
                        break
                said = self.must(program / "example", socket, "0.4")
            finally:
                daemon.terminate()
                daemon.communicate(timeout=120)
        self.assertEqual(daemon.returncode, 0)
        self.assertRegex(said, re.compile(r"^tick \d+: tip at .* mm, .* N$", re.MULTILINE))
        self.assertRegex(said, r"isovalue 0\.4 from tick \d+ on")


if __name__ == "__main__":
    sys.exit(unittest.main(argv=sys.argv[:1], verbosity=1))
