"""The list of settings: what people read has it as the contract has it, and a list with a fault
is refused with the place and the reason."""

import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROTO = ROOT / "proto"


def generate(field, *more):
    """The plugin on a list that has this field too: exit code and what it said."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "palpate/v1").mkdir(parents=True)
        text = (PROTO / "palpate/v1/render.proto").read_text()
        begin = "message RenderSettings {\n"
        # At its end: the isovalue's two come first.
        head, _, tail = text.partition(begin)
        body, _, rest = tail.partition("\n}\n")
        (folder / "palpate/v1/render.proto").write_text(
            f"{head}{begin}{body}\n  {field}\n}}\n{rest}")
        for options in ("geometry.proto", "setting.proto", "words.proto"):
            shutil.copy(PROTO / "palpate/v1" / options, folder / "palpate/v1")
        done = subprocess.run(
            ["protoc", f"--proto_path={folder}", f"--contract_out={folder}",
             f"--plugin=protoc-gen-contract={PROTO}/generate/protoc-gen-contract",
             "--contract_opt=cpp", "palpate/v1/render.proto"],
            capture_output=True, text=True, check=False)
        return done.returncode, done.stderr


class Written(unittest.TestCase):
    def test_the_tree_has_what_the_contract_declares(self):
        done = subprocess.run([PROTO / "generate/update.py", "--check"], capture_output=True,
                              text=True, check=False)
        self.assertEqual((done.returncode, done.stdout), (0, ""), done.stderr)


class Faults(unittest.TestCase):
    GOOD = 'label: "L" help: "what it does" minimum: 0 maximum: 1'

    def refused(self, field, why):
        code, said = generate(field)
        self.assertNotEqual(code, 0)
        self.assertIn(why, said)

    def test_a_good_one_is_taken(self):
        self.assertEqual(generate(f"optional double x = 90 [(setting) = {{{self.GOOD}}}];"),
                         (0, ""))

    def test_what_is_missing_is_told(self):
        self.refused("optional double x = 90;", "x has no option (setting)")
        self.refused('optional double x = 90 [(setting) = {label: "L" minimum: 0 maximum: 1}];',
                     "x: label and help are needed")
        self.refused('optional double x = 90 [(setting) = {label: "L" help: "h"}];',
                     "x: a number needs minimum and maximum")
        self.refused('optional int32 x = 90 [(setting) = {label: "L" help: "h"}];',
                     "x must be an optional double, bool or enum")
        self.refused('bool x = 90 [(setting) = {label: "L" help: "h"}];',
                     "x must be an optional double, bool or enum")

    def test_what_does_not_fit_is_told(self):
        self.refused(f'optional double x = 90 [(setting) = {{{self.GOOD} unit: "N"}}];',
                     "x: the name ends with the unit: ..._n")
        self.refused(f"optional double x = 90 [(setting) = {{{self.GOOD} default_number: 2}}];",
                     "x: default_number is not from minimum to maximum")
        self.refused(f'optional double x = 90 [(setting) = {{{self.GOOD} shown_with: "y"}}];',
                     "x: shown_with: y is no flag")
        self.refused('optional FreeSide x = 90 [(setting) = {label: "L" help: "h" '
                     'default_choice: "left"}];', "x: default_choice is one of below, above")
        self.refused('optional bool x = 90 [(setting) = {label: "L" help: "One."}];',
                     "x: help begins with a small letter and has no full stop")


if __name__ == "__main__":
    sys.exit(unittest.main(verbosity=1))
