"""The udev rules parse, and name every device that the daemon knows."""

import pathlib
import re
import shutil
import subprocess
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
RULES = ROOT / "deploy/udev/70-palpate.rules"

TOKEN = re.compile(r'([A-Z]+(?:\{[^}]+\})?)\s*(==|!=|\+=|=)\s*"([^"]*)"\s*(?:,\s*|$)')
MATCHES = {"ACTION", "SUBSYSTEM", "ENV{DEVTYPE}", "ATTR{idVendor}", "ATTR{idProduct}", "ATTR{guid}",
           "ATTR{is_local}"}
ASSIGNMENTS = {"GROUP": "=", "MODE": "=", "TAG": "+=", "ENV{ID_MM_DEVICE_IGNORE}": "=",
               "GOTO": "=", "LABEL": "="}


def parse(line):
    """Tokens (key, operator, value) of a rule; ValueError where it is none."""
    matches = list(TOKEN.finditer(line))
    if "".join(match.group() for match in matches) != line:
        raise ValueError(f"cannot read: {line}")
    for key, operator, _ in (match.groups() for match in matches):
        good = operator in ("==", "!=") if key in MATCHES else ASSIGNMENTS.get(key) == operator
        if not good:
            raise ValueError(f"{key} {operator} is no match or assignment of ours")
    return [match.groups() for match in matches]


def rules():
    lines = (line.strip() for line in RULES.read_text().splitlines())
    return [parse(line) for line in lines if line and not line.startswith("#")]


def known_ids():
    """(vendor, product) in the sources of the devices on USB."""
    found = set()
    for path in (ROOT / "server/device").rglob("*.cpp"):
        text = path.read_text()
        if "UsbMatch" in text:
            found |= set(re.findall(r"0x([0-9a-f]{4}), (?:\.product = )?0x([0-9a-f]{4})\}", text))
    return found


class UdevRules(unittest.TestCase):
    def test_every_jump_has_its_label(self):
        tokens = [token for rule in rules() for token in rule]
        jumps = {value for key, _, value in tokens if key == "GOTO"}
        self.assertEqual(jumps, {value for key, _, value in tokens if key == "LABEL"})

    def test_every_known_device_is_let_in(self):
        let_in, firewire = set(), []
        whole_vendors = {("1451", None)}  # the vendor's library opens them
        for rule in rules():
            values = {key: value for key, _, value in rule}
            if "GROUP" in values:
                if values.get("SUBSYSTEM") == "firewire":
                    firewire.append((values["ATTR{guid}"], values["ATTR{is_local}"]))
                else:
                    let_in.add((values["ATTR{idVendor}"], values.get("ATTR{idProduct}")))
                self.assertEqual((values["GROUP"], values["MODE"], values["TAG"]),
                                 ("palpate", "0660", "uaccess"))
        self.assertEqual(firewire, [("0x000b99*", "0")])
        self.assertEqual(let_in - whole_vendors, known_ids())
        self.assertEqual(let_in, {("2988", "0302"), ("2988", "0304"), ("0301", "2988"),
                                  ("0403", "cb48")} | whole_vendors)

    def test_what_is_no_rule_is_seen(self):
        for line in ('ATTR{idVendor}="2988"', 'GROUP=="palpate"', 'MODE="0660', 'FOO="1"'):
            with self.assertRaises(ValueError):
                parse(line)

    def test_udevadm_agrees(self):
        udevadm = shutil.which("udevadm")
        if not udevadm or subprocess.run([udevadm, "verify", "--help"],
                                         capture_output=True, check=False).returncode != 0:
            self.skipTest("no udevadm verify here (systemd 254)")
        subprocess.run([udevadm, "verify", "--resolve-names=never", RULES], check=True)


if __name__ == "__main__":
    sys.exit(unittest.main(verbosity=1))
