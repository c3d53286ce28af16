"""deploy/install-packages.sh asks apt for what is missing, and for nothing else."""

import os
import pathlib
import subprocess
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "deploy/install-packages.sh"


def asked_for(section, installed):
    """The packages that apt-get is asked to install, where dpkg-query knows `installed`."""
    with tempfile.TemporaryDirectory(prefix="palpate-install-packages-") as name:
        folder = pathlib.Path(name)
        (folder / "installed").write_text(installed)
        for program, text in (("dpkg-query", f"cat {folder}/installed"), ("sudo", 'exec "$@"'),
                              ("apt-get", f'echo "$@" >>{folder}/asked')):
            (folder / program).write_text(f"#!/bin/sh\n{text}\n")
            (folder / program).chmod(0o755)
        environment = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"}
        subprocess.run([SCRIPT, section], env=environment, check=True, capture_output=True)
        asked = folder / "asked"
        lines = asked.read_text().splitlines() if asked.exists() else []
    return {word for line in lines if line.startswith("install")
            for word in line.split()[1:] if not word.startswith("-")}


class InstallPackages(unittest.TestCase):
    def test_only_the_missing_packages_are_installed(self):
        self.assertEqual(asked_for("page", "installed bash \n"), {"nodejs", "npm"})
        self.assertEqual(asked_for("page", "installed nodejs \nconfig-files npm \n"), {"npm"})

    def test_what_another_package_provides_is_there(self):
        self.assertEqual(asked_for("page", "installed nodejs nodejs-dev, npm (= 11.0)\n"), set())


if __name__ == "__main__":
    unittest.main()
