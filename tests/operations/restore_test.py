"""What is felt comes back after palpated was killed, and only then."""

import re
import signal
import subprocess
import unittest
import warnings

import numpy as np

from support import CALL_S, PATIENCE_S, Daemon, nrrd, wait_until

SETTINGS = {"stiffness_n_per_mm": 0.7, "static_friction": 0.3, "dynamic_friction": 0.25,
            "viscosity_n_s_per_m": 0.125, "force_shading": True, "free_side": "above",
            "method": "bcc", "isovalue": 7.25}


def ball(edge=24):
    return np.linalg.norm(np.indices((edge,) * 3) - (edge - 1) / 2, axis=0)


class Restore(unittest.TestCase):
    def setUp(self):
        self.daemon = self.enterContext(Daemon())
        self.ball = self.daemon.folder / "ball.nrrd"
        self.ball.write_bytes(nrrd(ball(), np.diag([0.5] * 3).tolist()))

    def felt(self):
        """What clients see of it: settings, volume and place, without their revisions."""
        with self.daemon.connect() as conn:
            volume, place = vars(conn.volume.info()), vars(conn.volume.place())
            parts = conn.settings.all(), volume, place
        return [{key: np.asarray(value).tolist() for key, value in part.items()
                 if not key.endswith(("revision", "tick"))} for part in parts]

    def sessions(self):
        return list((self.daemon.folder / "state").glob("sessions/*"))

    def change_everything(self):
        """Returns what is felt then."""
        with self.daemon.connect() as conn:
            conn.volume.load(self.ball, device_mm_per_volume_mm=2.0)
            conn.settings.update(**SETTINGS)
            conn.volume.place(move_mm=(3, 0, 0), scale_by=0.75)
        return self.felt()

    def wait_for_disk(self, text):
        self.assertTrue(wait_until(
            # One that is being written is renamed any moment.
            lambda: any(text in file.read_text() for file in self.sessions()
                        if file.suffix == ".toml")))

    def start_again(self, number=signal.SIGKILL):
        """Returns what is felt then."""
        self.daemon.end(number)
        self.daemon.start()
        return self.felt()

    def log(self):
        return "".join(self.daemon.said)

    def test_settings_volume_and_place_come_back_after_each_end(self):
        felt = self.change_everything()
        for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGABRT, signal.SIGINT):
            self.assertEqual(self.start_again(number), felt)
            self.assertIn(str(self.ball), self.log())
            self.assertNotIn("edits", self.log())

    def test_a_fresh_start_is_as_configured(self):
        configured = self.felt()
        self.change_everything()
        self.daemon.command.append("--fresh")
        self.assertEqual(self.start_again(signal.SIGTERM)[:2], configured[:2])

    def test_the_place_of_a_resampled_volume_says_that_it_is_not_kept(self):
        with self.daemon.connect() as conn, warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            conn.edit.filter("resample", spacing_mm=2.0)
            self.assertIn("save it", conn.volume.place(center_mm=(3, 4, 5)).not_kept)
            conn.edit.undo()
            self.assertEqual(conn.volume.place(center_mm=(3, 4, 5)).not_kept, "")

    def test_edits_that_an_end_loses_are_told(self):
        for number in (signal.SIGKILL, signal.SIGTERM):
            with self.daemon.connect() as conn:
                for n in range(5):
                    conn.edit.sphere((0, 0, n), 3.0, "set", 0.5)
            self.start_again(number)
            with self.daemon.connect() as conn:
                self.assertIn("edits that are lost: 5", " ".join(conn.volume.info().warnings))

    def test_ends_in_order_before_it_is_back_are_no_crashes(self):
        felt = self.change_everything()
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
        self.assertEqual(self.felt(), felt)

    def test_a_volume_that_is_gone_does_not_keep_it_from_starting(self):
        felt, _, _ = self.change_everything()
        self.ball.unlink()
        settings, volume, _ = self.start_again()
        self.assertIn(str(self.ball), self.log())
        self.assertEqual(volume["source"], "builtin:sphere:48")
        self.assertEqual(settings["stiffness_n_per_mm"], felt["stiffness_n_per_mm"])

    def start_with_changed_session(self, change):
        self.wait_for_disk("sphere:48")
        self.daemon.end(signal.SIGKILL)
        file, = (file for file in self.sessions() if file.suffix == ".toml")
        file.write_text(change(file.read_text()))
        self.daemon.start()
        return self.felt()

    def test_a_damaged_file_does_not_keep_it_from_starting(self):
        configured = self.felt()
        del configured[1]["warnings"]

        def far_too_stiff(text):
            """As it was felt, not as it was configured."""
            before, _, after = text.rpartition("stiffness_n_per_mm = 0.5")
            return f"{before}stiffness_n_per_mm = 500.0{after}"

        # session_file_test has more of them.
        for change in (lambda _: "[volume", far_too_stiff):
            felt = self.start_with_changed_session(change)
            self.assertIn("does not come back", " ".join(felt[1].pop("warnings")))
            self.assertEqual(felt, configured)

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

        _, volume, _ = self.start_with_changed_session(of_another_volume)
        self.assertEqual(volume["source"], "builtin:sphere:48")

    def test_an_upload_does_not_come_back_but_the_settings_do(self):
        with self.daemon.connect() as conn:
            conn.volume.upload(ball())
            conn.settings.update(**SETTINGS)
        settings, volume, _ = self.start_again()
        self.assertEqual(settings["stiffness_n_per_mm"], 0.7)
        self.assertEqual(volume["source"], "builtin:sphere:48")
        self.assertIn("upload", self.log())
        self.assertIn("upload", " ".join(volume["warnings"]))

    def test_a_second_daemon_on_the_socket_takes_nothing_of_the_first(self):
        felt = self.change_everything()
        command = self.daemon.command
        place = command.index("--volume") + 1
        for volume in command[place], "builtin:bumps:16":
            second = subprocess.run([*command[:place], volume, *command[place + 1:]],
                                    capture_output=True, timeout=CALL_S)
            self.assertNotEqual(second.returncode, 0)
        self.assertEqual(self.start_again(), felt)


if __name__ == "__main__":
    unittest.main()
