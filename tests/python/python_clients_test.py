"""Which call of the contract each client can make: the table in deploy/guides/clients.md, against
the services' descriptors and what the clients really have."""

import importlib
import pathlib
import pkgutil
import subprocess
import typing
import unittest

import palpate
import palpate.v1
from support import PALPATE, PATIENCE_S

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE = ROOT / "deploy/guides/clients.md"
BEGIN, END = "<!-- calls: begin -->", "<!-- calls: end -->"


def rows_of_the_page():
    """Call of the contract: C++, Python, command line, viewer. A cell that begins with "no:" says
    why. The viewer's cell names the C++ call that it makes."""
    table = PAGE.read_text().split(BEGIN + "\n")[1].split(END)[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table[2:]]
    return {call.strip("`"): [cell.strip("`") for cell in cells] for call, *cells in rows}


CALLS = rows_of_the_page()


def calls_of_the_contract():
    """Service.Method of each message module of palpate.v1, in its order."""
    for module in pkgutil.iter_modules(palpate.v1.__path__):
        if not module.name.endswith("_pb2"):
            continue
        file = importlib.import_module(f"palpate.v1.{module.name}").DESCRIPTOR
        for service in file.services_by_name.values():
            for method in service.methods:
                yield f"{service.name}.{method.name}"


def python_call(path):
    """What conn.volume.load is, by the types that the properties of a connection declare."""
    held = palpate.Connection
    for name in path.split(".")[1:]:
        found = getattr(held, name)
        if isinstance(found, property):
            held = typing.get_type_hints(found.fget)["return"]
        else:
            held = found
    return held


class Clients(unittest.TestCase):
    def test_every_call_of_the_contract_has_its_row(self):
        self.assertEqual(sorted(CALLS), sorted(calls_of_the_contract()))
        for call, cells in CALLS.items():
            self.assertEqual((len(cells), all(cells)), (4, True), call)

    def test_cpp_has_its_calls(self):
        headers = "".join((ROOT / "client/sdk" / name).read_text()
                          for name in ("calls.h", "client.h"))
        for call, (cpp, *_) in CALLS.items():
            self.assertRegex(headers, rf"\b{cpp}\(", call)

    def test_python_has_its_calls(self):
        for call, (_, path, *_) in CALLS.items():
            self.assertTrue(callable(python_call(path)) or path.endswith((".info", ".state")),
                            f"{call}: {path}")

    def test_the_command_line_has_its_commands(self):
        for call, (_, _, command, _) in CALLS.items():
            if command.startswith("no:"):
                continue
            ran = subprocess.run([PALPATE, *command.split()[1:], "--help"], capture_output=True,
                                 text=True, timeout=PATIENCE_S, check=False)
            self.assertEqual(ran.returncode, 0, f"{call}: {command}: {ran.stderr}")
            # The help of this command, not of one above it.
            self.assertRegex(ran.stdout, rf"Usage: \S*{command}( |$)", call)

    def test_the_viewer_makes_its_calls(self):
        source = "".join(path.read_text() for path in (ROOT / "client/view").rglob("*.[ch]*"))
        for call, (*_, viewer) in CALLS.items():
            if not viewer.startswith("no:"):
                self.assertRegex(source, rf"(\.|->|::){viewer}(\(| = )", call)
