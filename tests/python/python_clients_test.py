"""Which call of the contract each client can make: the table in deploy/guides/clients.md, against the
services' descriptors and what the clients really have.

With --write this file writes the table."""

import importlib
import pathlib
import pkgutil
import re
import subprocess
import sys
import typing
import unittest

import palpate
import palpate.v1
from support import PALPATE, PATIENCE_S

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE = ROOT / "deploy/guides/clients.md"
BEGIN, END = "<!-- calls: begin -->", "<!-- calls: end -->"
NO_FILES = "no: it opens no files yet; use the command line"

# Call of the contract: C++, Python, command line, viewer. A cell that begins with "no:" says why.
# The viewer's cell names the C++ call that it makes.
CALLS = {
    "PoseService.StreamPoses": ("ReadPoses", "conn.poses", "palpate watch", "on_poses"),
    "RenderService.GetSettings": ("GetSettings", "conn.settings.all", "palpate settings",
                                  "NewestSettings"),
    "RenderService.UpdateSettings": ("Set", "conn.settings.update", "palpate set", "Set"),
    "RegistrationService.GetRegistration": (
        "GetPlacement", "conn.volume.place", "palpate place",
        "no: it shows the place by drawing the volume there"),
    "RegistrationService.UpdateRegistration": (
        "Place", "conn.volume.place", "palpate place",
        "no: the stylus moves the volume, with the clutch tool"),
    "VolumeService.GetVolume": ("GetVolume", "conn.volume.info", "palpate info",
                                "no: its copy of the volume says the same"),
    "VolumeService.LoadVolume": ("LoadVolume", "conn.volume.load", "palpate load", NO_FILES),
    "VolumeService.UploadVolume": ("UploadVolume", "conn.volume.upload", "palpate upload",
                                   NO_FILES),
    "VolumeService.EditVolume": ("Apply", "conn.edit.sphere", "palpate edit", "Apply"),
    "VolumeService.FilterVolume": ("RunFilter", "conn.edit.filter", "palpate edit filter",
                                   "RunFilter"),
    "VolumeService.UndoEdit": ("Undo", "conn.edit.undo", "palpate undo", "Undo"),
    "VolumeService.RedoEdit": ("Redo", "conn.edit.redo", "palpate redo", "Redo"),
    "VolumeService.RevertVolume": ("Revert", "conn.edit.revert", "palpate revert",
                                   "no: it takes back one stroke after the other"),
    "VolumeService.SaveVolume": ("SaveVolume", "conn.volume.save", "palpate save", NO_FILES),
    "VolumeService.StreamVolume": ("DownloadVolume", "conn.volume.follow", "palpate download",
                                   "TakeVolumeUpdate"),
    "SeriesService.LoadSeries": ("LoadSeries", "conn.series.load", "palpate series load", NO_FILES),
    "SeriesService.GetSeries": ("GetSeries", "conn.series.state", "palpate series info",
                                "GetSeries"),
    "SeriesService.ControlSeries": ("ControlSeries", "conn.series.configure", "palpate series play",
                                    "ControlSeries"),
    "RecordingService.StartRecording": ("StartRecording", "conn.recording.start",
                                        "palpate record start", "StartRecording"),
    "RecordingService.StopRecording": ("StopRecording", "conn.recording.stop",
                                       "palpate record stop", "StopRecording"),
    "RecordingService.GetRecording": ("GetRecording", "conn.recording.state",
                                      "palpate record status", "GetRecording"),
    "RecordingService.Mark": ("Mark", "conn.recording.mark", "palpate mark",
                              "no: markers are for scripts and who watches them"),
    "RecordingService.Replay": ("Replay", "conn.recording.replay", "palpate replay", NO_FILES),
    "DeviceService.GetDevice": ("GetDevice", "conn.device.info", "palpate device info",
                                "GetDevice"),
    "DeviceService.ListDevices": ("ListDevices", "conn.device.list", "palpate device list",
                                  "no: for those who set up the workstation"),
    "DeviceService.EnableForces": ("EnableForces", "conn.device.enable", "palpate device enable",
                                   "EnableForces"),
    "DeviceService.DisableForces": ("DisableForces", "conn.device.disable",
                                    "palpate device disable", "DisableForces"),
    "DeviceService.StopForces": ("StopForces", "conn.device.stop", "palpate device stop",
                                 "StopForces"),
    "DeviceService.CalibrateDevice": ("CalibrateDevice", "conn.device.calibrate",
                                      "palpate device calibrate",
                                      "no: for those who set up the workstation"),
}


def calls_of_the_contract():
    """Service.Method of each message module of palpate.v1, in its order."""
    for module in pkgutil.iter_modules(palpate.v1.__path__):
        if not module.name.endswith("_pb2"):
            continue
        file = importlib.import_module(f"palpate.v1.{module.name}").DESCRIPTOR
        for service in file.services_by_name.values():
            for method in service.methods:
                yield f"{service.name}.{method.name}"


def quoted(cell):
    return cell if cell.startswith("no:") else f"`{cell}`"


def table():
    lines = ["| call | C++ | Python | command line | viewer |", "|---|---|---|---|---|"]
    for call, cells in CALLS.items():
        lines.append(f"| `{call}` | {' | '.join(map(quoted, cells))} |")
    return "\n".join(lines) + "\n"


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
            self.assertTrue(all(cells), f"{call} has an empty cell")

    def test_the_page_has_the_table(self):
        written = PAGE.read_text().split(BEGIN + "\n")[1].split(END)[0]
        self.assertEqual(written, table(), f"run {pathlib.Path(__file__).name} --write")

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
            ran = subprocess.run([PALPATE, *command.split()[1:], "--help"], capture_output=True,
                                 text=True, timeout=PATIENCE_S, check=False)
            self.assertEqual(ran.returncode, 0, f"{call}: {command}: {ran.stderr}")
            # The help of this command, not of one above it.
            self.assertRegex(ran.stdout, rf"Usage: \S*{command}( |$)", call)

    def test_the_viewer_makes_its_calls(self):
        source = "".join(path.read_text() for path in (ROOT / "client/view").rglob("*.cpp"))
        for call, (*_, viewer) in CALLS.items():
            if not viewer.startswith("no:"):
                self.assertRegex(source, rf"(\.|->|::){viewer}(\(| = )", call)


if __name__ == "__main__" and "--write" in sys.argv:
    before, rest = PAGE.read_text().split(BEGIN + "\n")
    PAGE.write_text(f"{before}{BEGIN}\n{table()}{END}{rest.split(END)[1]}")
