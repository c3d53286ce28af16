"""What is felt comes back after palpated was killed, and only then."""

import re
import signal
import subprocess
import unittest
import zlib

import numpy as np

from palpate.v1 import registration_pb2, registration_pb2_grpc, render_pb2, volume_pb2
from support import CALL_S, PATIENCE_S, Client, Daemon, nrrd, wait_until

SETTINGS = {"stiffness_n_per_mm": 0.7, "static_friction": 0.3, "dynamic_friction": 0.25,
            "viscosity_n_s_per_m": 0.125, "force_shading": True,
            "free_side": render_pb2.FREE_SIDE_ABOVE,
            "method": render_pb2.DECOMPOSITION_METHOD_BCC}


def ball(edge=24, spacing_mm=0.5):
    values = np.linalg.norm(np.indices((edge,) * 3) - (edge - 1) / 2, axis=0)
    return nrrd(values, np.diag([spacing_mm] * 3).tolist())


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
        self.ball.write_bytes(ball())

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
        return "".join(self.daemon.said)

    def test_settings_volume_and_place_come_back_after_a_crash(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
        for number in (signal.SIGKILL, signal.SIGABRT):
            again = Felt(self.start_again(number))
            self.assertEqual(again.settings, felt.settings)
            self.assertEqual(again.registration, felt.registration)
            for volume in (felt.volume, again.volume):
                volume.ClearField("volume_revision")
                volume.ClearField("loaded_revision")
            self.assertEqual(again.volume, felt.volume)
            self.assertIn(str(self.ball), self.log())
            self.assertNotIn("edits", self.log())
            self.wait_for_disk("isovalue = 7.25")

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
            felt = self.change_everything(client)
        self.daemon.end(signal.SIGKILL)
        for _ in range(3):
            # The signal is there before the daemon looks for it.
            process = subprocess.Popen(
                self.daemon.command, cwd=self.daemon.folder, text=True, stderr=subprocess.PIPE,
                preexec_fn=lambda: signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM]))
            process.terminate()
            _, said = process.communicate(timeout=PATIENCE_S)
            self.assertEqual(process.returncode, 0, said)
            self.assertNotIn("ready on", said)
        self.daemon.start()
        with Client(self.daemon) as client:
            self.assertEqual(Felt(client).settings, felt.settings)

    def test_edits_that_are_lost_are_said(self):
        with Client(self.daemon) as client:
            before = Felt(client).volume
            self.assertGreater(client.carve(16, 16, 16).changed_voxels, 0)
            self.wait_for_disk("is_edited = true")
        again = self.start_again()
        self.assertIn("edits", self.log())
        self.assertEqual(Felt(again).volume.value_max, before.value_max)

    def test_a_volume_that_is_gone_does_not_keep_it_from_starting(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
        self.ball.unlink()
        again = Felt(self.start_again())
        self.assertIn(str(self.ball), self.log())
        self.assertEqual(again.volume.source, "builtin:sphere:48")
        self.assertEqual(again.settings.stiffness_n_per_mm, felt.settings.stiffness_n_per_mm)

    def start_with_changed_session(self, change):
        self.wait_for_disk("sphere:48")
        self.daemon.end(signal.SIGKILL)
        file, = self.sessions()
        file.write_text(change(file.read_text()))
        self.daemon.start()
        with Client(self.daemon) as client:
            return Felt(client)

    def test_a_damaged_file_does_not_keep_it_from_starting(self):
        with Client(self.daemon) as client:
            configured = Felt(client)

        def far_too_stiff(text):
            """As it was felt, not as it was configured."""
            before, _, after = text.rpartition("stiffness_n_per_mm = 0.5")
            return f"{before}stiffness_n_per_mm = 500.0{after}"

        # session_file_test has more of them.
        for change in (lambda _: "[volume", lambda _: "[volume]\n[configured]\n[haptics]\n",
                       far_too_stiff):
            again = self.start_with_changed_session(change)
            self.assertEqual(again.volume.source, configured.volume.source)
            self.assertEqual(again.settings, configured.settings)

    def test_a_volume_that_clients_may_not_load_does_not_come_back(self):
        config, allowed = self.daemon.folder / "palpated.toml", self.daemon.folder / "allowed"
        allowed.mkdir()
        config.write_text(config.read_text().replace(
            'load_folders = ["/"]', f'load_folders = ["{allowed}"]'))

        def of_another_volume(text):
            before, section, after = text.partition("[volume]\n")
            self.assertTrue(section)
            return before + section + re.sub("^source = .*$", f'source = "{self.ball}"', after,
                                             flags=re.MULTILINE)

        again = self.start_with_changed_session(of_another_volume)
        self.assertEqual(again.volume.source, "builtin:sphere:48")

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
        self.assertIn("upload", self.log())

    def test_a_second_daemon_on_the_socket_takes_nothing_of_the_first(self):
        with Client(self.daemon) as client:
            felt = self.change_everything(client)
        second = subprocess.run(self.daemon.command, capture_output=True, timeout=CALL_S)
        self.assertNotEqual(second.returncode, 0)
        self.assertEqual(Felt(self.start_again()).settings, felt.settings)


if __name__ == "__main__":
    unittest.main()
