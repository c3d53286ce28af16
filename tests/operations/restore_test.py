"""What is felt comes back after palpated was killed, and only then."""

import signal
import struct
import subprocess
import unittest
import zlib

from palpate.v1 import registration_pb2, registration_pb2_grpc, render_pb2, volume_pb2
from support import CALL_S, Client, Daemon, wait_until

SETTINGS = {"stiffness_n_per_mm": 0.7, "static_friction": 0.3, "dynamic_friction": 0.25,
            "viscosity_n_s_per_m": 0.125, "force_shading": True,
            "free_side": render_pb2.FREE_SIDE_ABOVE,
            "method": render_pb2.DECOMPOSITION_METHOD_BCC}


def write_ball(path, edge=24, spacing_mm=0.5):
    middle = (edge - 1) / 2
    values = [((x - middle) ** 2 + (y - middle) ** 2 + (z - middle) ** 2) ** 0.5
              for z in range(edge) for y in range(edge) for x in range(edge)]
    path.write_bytes(b"NRRD0004\ntype: float\ndimension: 3\nsizes: %d %d %d\nspacings: %g %g %g\n"
                     b"endian: little\nencoding: raw\n\n" % ((edge,) * 3 + (spacing_mm,) * 3)
                     + struct.pack(f"<{len(values)}f", *values))


class Felt:
    """What clients see of it."""

    def __init__(self, client):
        self.settings = client.render.GetSettings(
            render_pb2.GetSettingsRequest(), timeout=CALL_S).settings
        self.volume = client.volume.GetVolume(volume_pb2.GetVolumeRequest(), timeout=CALL_S).volume
        self.registration = registration_pb2_grpc.RegistrationServiceStub(
            client.channel).GetRegistration(registration_pb2.GetRegistrationRequest(),
                                            timeout=CALL_S).registration


def load(client, source, **options):
    for event in client.volume.LoadVolume(
            volume_pb2.LoadVolumeRequest(source=str(source), **options), timeout=CALL_S):
        last = event
    return last.result.volume


def set_all(client, isovalue):
    request = render_pb2.UpdateSettingsRequest()
    for key, value in {**SETTINGS, "isovalue": isovalue}.items():
        setattr(request.settings, key, value)
        request.update_mask.paths.append(key)
    client.render.UpdateSettings(request, timeout=CALL_S)


def move(client, x_mm):
    request = registration_pb2.UpdateRegistrationRequest()
    request.translate_mm.x = x_mm
    request.scale_by = 0.75
    registration_pb2_grpc.RegistrationServiceStub(client.channel).UpdateRegistration(
        request, timeout=CALL_S)


class Restore(unittest.TestCase):
    def setUp(self):
        self.daemon = self.enterContext(Daemon())
        self.ball = self.daemon.folder / "ball.nrrd"
        write_ball(self.ball)

    def sessions(self):
        return list((self.daemon.folder / "state").glob("sessions/*"))

    def change_everything(self, client):
        """And waits until it is on the disk."""
        load(client, self.ball, device_mm_per_volume_mm=2.0)
        set_all(client, isovalue=7.25)
        move(client, 3.0)
        felt = Felt(client)
        self.wait_for_disk("isovalue = 7.25")
        registrations = self.daemon.folder / "state" / "registrations.toml"
        self.assertTrue(wait_until(
            lambda: registrations.exists() and "ball.nrrd" in registrations.read_text()))
        return felt

    def wait_for_disk(self, text):
        self.assertTrue(wait_until(
            # One that is being written is renamed any moment.
            lambda: any(text in file.read_text() for file in self.sessions()
                        if file.suffix == ".toml")))

    def start_again(self, number=signal.SIGKILL):
        self.daemon.end(number)
        self.daemon.start()
        return self.enterContext(Client(self.daemon))

    def log(self):
        return "".join(self.daemon.log)

    def test_settings_volume_and_place_come_back_after_a_kill(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
        for _ in range(2):  # as often as a daemon that does not last for a minute
            again = Felt(self.start_again())
            self.assertEqual(again.settings, felt.settings)
            self.assertEqual(again.registration, felt.registration)
            for volume in (felt.volume, again.volume):
                volume.ClearField("volume_revision")
                volume.ClearField("loaded_revision")
            self.assertEqual(again.volume, felt.volume)
            self.assertIn(f"{self.ball} and the settings are back", self.log())
            self.assertNotIn("edits", self.log())
            self.wait_for_disk("isovalue = 7.25")

    def test_nor_is_it_lost_after_an_abort(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
        self.assertEqual(Felt(self.start_again(signal.SIGABRT)).settings, felt.settings)

    def test_after_an_end_in_order_all_is_as_configured(self):
        with Client(self.daemon) as client:
            configured = Felt(client)
            self.change_everything(client)
        again = Felt(self.start_again(signal.SIGTERM))
        self.assertEqual(again.settings, configured.settings)
        self.assertEqual(again.volume.source, configured.volume.source)
        self.daemon.end()
        self.assertEqual(self.sessions(), [])

    def test_ends_in_order_before_it_is_back_are_no_crashes(self):
        with Client(self.daemon) as client:
            load(client, "builtin:gyroid:160")
            set_all(client, isovalue=0.25)
            felt = Felt(client)
        self.wait_for_disk("isovalue = 0.25")
        self.daemon.end(signal.SIGKILL)
        for _ in range(3):
            process = subprocess.Popen(self.daemon.command, cwd=self.daemon.folder, text=True,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            said = []
            while not said or "loading builtin:gyroid:160" not in said[-1]:
                said.append(process.stderr.readline())
            process.send_signal(signal.SIGTERM)
            said += process.stderr.readlines()
            process.stderr.close()
            self.assertEqual(process.wait(CALL_S), 0, said)
            self.assertIn("while the volume was loading", said[-1])
        self.daemon.start()
        with Client(self.daemon) as client:
            self.assertEqual(Felt(client).settings, felt.settings)

    def test_edits_that_are_lost_are_said(self):
        with Client(self.daemon) as client:
            before = Felt(client).volume
            self.assertGreater(client.carve(16, 16, 16).changed_voxels, 0)
            self.wait_for_disk("is_edited = true")
        again = self.start_again()
        self.assertIn("edits that were not saved are lost", self.log())
        self.assertEqual(Felt(again).volume.value_max, before.value_max)

    def test_a_volume_that_is_gone_does_not_keep_it_from_starting(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
        self.ball.unlink()
        again = Felt(self.start_again())
        self.assertIn(f"{self.ball} does not come back", self.log())
        self.assertEqual(again.volume.source, "builtin:sphere:48")
        self.assertEqual(again.settings.stiffness_n_per_mm, felt.settings.stiffness_n_per_mm)

    def test_a_damaged_file_does_not_keep_it_from_starting(self):
        for damage in (b"", b"[volume", b"\xff\xfe\x00", b"[volume]\n[configured]\n[haptics]\n",
                       b"volume = 3\nconfigured = 1\nhaptics = 2\n"):
            with self.subTest(damage=damage):
                self.daemon.end(signal.SIGKILL)
                self.sessions()[0].write_bytes(damage)
                self.daemon.start()
                with Client(self.daemon) as client:
                    self.assertEqual(Felt(client).volume.source, "builtin:sphere:48")
                self.wait_for_disk("sphere:48")

    def test_values_out_of_range_in_the_file_are_not_felt(self):
        with Client(self.daemon) as client:
            configured = Felt(client)
        self.wait_for_disk("sphere:48")
        self.daemon.end(signal.SIGKILL)
        file = self.sessions()[0]
        text = file.read_text()
        # What is felt, not what was configured.
        configured_part, found, felt = text.rpartition("stiffness_n_per_mm = 0.5")
        self.assertTrue(found)
        file.write_text(f"{configured_part}stiffness_n_per_mm = 500.0{felt}")
        self.daemon.start()
        with Client(self.daemon) as client:
            self.assertEqual(Felt(client).settings, configured.settings)
        self.assertIn("does not come back", self.log())

    def test_a_volume_that_clients_may_not_load_does_not_come_back(self):
        self.wait_for_disk("sphere:48")
        self.daemon.end(signal.SIGKILL)
        allowed = self.daemon.folder / "allowed"
        allowed.mkdir()
        config = self.daemon.folder / "palpated.toml"
        config.write_text(config.read_text().replace(
            'load_folders = ["/"]', f'load_folders = ["{allowed}"]'))
        file = self.sessions()[0]
        lines = file.read_text().splitlines(keepends=True)
        section = lines.index("[volume]\n")
        for n in range(section, len(lines)):
            if lines[n].startswith("source"):
                lines[n] = f'source = "{self.ball}"\n'
        file.write_text("".join(lines))
        self.daemon.start()
        with Client(self.daemon) as client:
            self.assertEqual(Felt(client).volume.source, "builtin:sphere:48")
        self.assertIn("does not come back", self.log())

    def test_what_is_configured_otherwise_now_is_as_configured(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
        self.daemon.end(signal.SIGKILL)
        config = self.daemon.folder / "palpated.toml"
        config.write_text(config.read_text() + "[haptics]\nstiffness_n_per_mm = 0.2\n")
        self.daemon.command += ["--isovalue", "5.5"]
        self.daemon.start()
        with Client(self.daemon) as client:
            again = Felt(client)
        self.assertEqual(again.volume.source, str(self.ball))
        self.assertEqual(again.settings.stiffness_n_per_mm, 0.2)
        self.assertEqual(again.settings.isovalue, 5.5)
        self.assertEqual(again.settings.static_friction, felt.settings.static_friction)

    def test_another_configured_volume_is_what_is_felt(self):
        with Client(self.daemon) as client:
            self.change_everything(client)
        self.daemon.end(signal.SIGKILL)
        at = self.daemon.command.index("--volume") + 1
        self.daemon.command[at] = "builtin:bumps:32"
        self.daemon.start()
        with Client(self.daemon) as client:
            self.assertEqual(Felt(client).volume.source, "builtin:bumps:32")
        self.assertIn("another volume is configured now", self.log())

    def test_an_upload_does_not_come_back_but_the_settings_do(self):
        with Client(self.daemon) as client:
            content = self.ball.read_bytes()
            requests = [volume_pb2.UploadVolumeRequest(), volume_pb2.UploadVolumeRequest()]
            requests[0].start.name = "ball.nrrd"
            requests[0].start.size_bytes = len(content)
            requests[0].start.crc32 = zlib.crc32(content)
            requests[1].data = content
            client.volume.UploadVolume(iter(requests), timeout=CALL_S)
            set_all(client, isovalue=7.25)
            self.wait_for_disk("isovalue = 7.25")
        again = self.start_again()
        self.assertEqual(Felt(again).settings.stiffness_n_per_mm, 0.7)
        self.assertEqual(Felt(again).volume.source, "builtin:sphere:48")
        self.assertIn("uploads and series are loaded again by clients", self.log())

    def test_one_that_dies_while_it_brings_it_back_starts_as_configured(self):
        with Client(self.daemon) as client:
            self.change_everything(client)
        self.daemon.end(signal.SIGKILL)
        # Takes a second and more.
        with self.ball.open("wb") as file:
            file.write(b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 900 900 900\n"
                       b"encoding: raw\n\n\x09")
            file.truncate(file.tell() - 1 + 900 ** 3)
        for _ in range(2):
            with subprocess.Popen(self.daemon.command, cwd=self.daemon.folder, text=True,
                                  stderr=subprocess.PIPE) as again:
                self.assertTrue(any(f"loading {self.ball}" in line for line in again.stderr))
                again.kill()
        self.daemon.start()
        self.assertIn("did not last with it", self.log())
        with Client(self.daemon) as client:
            self.assertEqual(Felt(client).volume.source, "builtin:sphere:48")

    def test_a_second_daemon_takes_nothing_of_the_first(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
            with Daemon(state=self.daemon.folder / "state") as other, Client(other) as its:
                self.assertEqual(Felt(its).volume.source, "builtin:sphere:48")
            same_socket = subprocess.run(self.daemon.command, capture_output=True, timeout=CALL_S)
            self.assertNotEqual(same_socket.returncode, 0)
        self.assertEqual(Felt(self.start_again()).settings, felt.settings)


if __name__ == "__main__":
    unittest.main()
