"""palpate-web between a real palpated and guests: what guests copy is the daemon's volume, what they
are told is what the daemon does, and everything comes back after a loss. How the server judges
guests is tested in web_http_test.cpp, how groups are made in web_volume_test.cpp."""

import json
import pathlib
import resource
import signal
import subprocess
import tempfile
import threading
import unittest

import numpy as np

from palpate._brick_hash import hash_of_bricks
from palpate._geometry import matrix_of_map

from free_port import free_port
from gateway import PALPATE_WEB, Copy, Gateway, Guest
from support import Daemon, DaemonTest, wait_until


def made_user(name, *keys):
    """Its token, and its lines of the configuration."""
    steers = [part for key in keys for part in ("--may-steer", key)]
    text = subprocess.run([PALPATE_WEB, "user", name, *steers], check=True, capture_output=True,
                          text=True).stdout
    comment, _, lines = text.partition("\n")
    return comment.split()[-1], lines


class WebTest(DaemonTest):
    config = ""
    more = ()

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.gateway = cls.enterClassContext(Gateway(cls.daemon, cls.more, cls.config))

    def guest(self, **login):
        return self.enterContext(Guest(self.gateway, **login))

    def require_equal_copy(self, guest, name, groups):
        """Whether the manifest's groups were still there."""
        blob = guest.blob(name)
        if blob is None:
            return False
        manifest = json.loads(blob)
        copy = Copy(guest, manifest, groups)
        if copy.lost:
            return False
        halves = hash_of_bricks(np.arange(len(copy.bricks)), copy.bricks)
        self.assertEqual(b"".join(int(half).to_bytes(8, "big") for half in halves).hex(),
                         manifest["content_hash"])
        return True


class Volumes(WebTest):
    volume = "builtin:bumps:50"

    def test_copies_are_the_daemons_volume_while_it_is_edited(self):
        guest = self.guest()
        guest.wait_for("manifest")
        enough = threading.Event()

        def edit():
            random = np.random.default_rng(3)
            while not enough.is_set():
                self.conn.edit.sphere(tuple(random.uniform(0, 49, 3)), 4.0, "add", 0.01,
                                      frame="index")

        editor = threading.Thread(target=edit)
        editor.start()
        try:
            groups, judged, seen = {}, 0, 0
            while judged < 5:
                self.assertTrue(wait_until(lambda: len(guest.manifests) > seen))
                name, seen = guest.manifests[-1], len(guest.manifests)
                judged += self.require_equal_copy(guest, name, groups)
        finally:
            enough.set()
            editor.join()
        revision = self.conn.volume.info().volume_revision
        guest.wait_for("manifest", lambda manifest: manifest["revision"] == revision)
        self.assertTrue(self.require_equal_copy(guest, guest.topics["manifest"]["name"], groups))

    def test_another_volume(self):
        guest = self.guest()
        for volume, size in (("builtin:sphere:16", 16), ("builtin:gyroid:33", 33)):
            self.daemon.palpate("load", volume, "--discard")
            guest.wait_for("volume", lambda message: message.name == volume)
            manifest = guest.wait_for("manifest", lambda message: json.loads(
                guest.blob(message["name"]) or b'{"lattice": {"size": []}}')["lattice"]["size"]
                == [size] * 3)
            self.assertTrue(self.require_equal_copy(guest, manifest["name"], {}))
            # The first manifest of the volume came after its name.
            said = [message for message in guest.heard if message["type"] in ("volume", "manifest")]
            named = max(place for place, message in enumerate(said)
                        if message["type"] == "volume" and message["fact"].name == volume)
            self.assertEqual([message["type"] for message in said[named + 1:]], ["manifest"])
            info = self.conn.volume.info()
            placement = matrix_of_map(guest.wait_for("placement").device_from_index)[:3]
            np.testing.assert_allclose(placement, info.device_from_index[:3], atol=1e-12)
        self.daemon.palpate("load", self.volume, "--discard")


    def test_a_gateway_by_the_socket_is_warned_of(self):
        self.assertTrue(wait_until(lambda: sum("warning" in line
                                               for line in self.gateway.said) == 1))


class WithoutVolume(WebTest):
    more = ("--no-volume",)

    def test_guests_see_the_overview_alone(self):
        guest = self.guest()
        manifest = json.loads(guest.blob(guest.wait_for("manifest")["name"]))
        self.assertEqual(manifest["groups"], "")
        self.assertEqual(len(guest.blob(manifest["overview"]["name"])), 4 * 12 ** 3)


class Steering(WebTest):
    if PALPATE_WEB:
        token, config = made_user("lecturer-1", "isovalue", "force_shading")
        other, more_config = made_user("lecturer-2", "isovalue")
        config += more_config

    def test_a_user_steers_what_was_allowed_and_all_are_told(self):
        watcher, lecturer = self.guest(), self.guest(token=self.token)
        self.assertEqual(lecturer.wait_for("hello")["may_steer"], ["isovalue", "force_shading"])
        self.assertEqual(watcher.wait_for("hello")["may_steer"], [])
        self.assertEqual(lecturer.steer("isovalue", 0.25), "")
        self.assertEqual(self.conn.settings.isovalue, 0.25)
        watcher.wait_for("settings", lambda message: message.settings.isovalue == 0.25)
        change = watcher.wait_for("steering", lambda message: message["changes"])["changes"][-1]
        self.assertEqual((change["user"], change["key"], change["value"]),
                         ("lecturer-1", "isovalue", 0.25))
        self.assertNotEqual(lecturer.steer("isovalue", 1e9), "")  # palpated refuses it
        self.assertEqual(lecturer.steer("force_shading", 1), "")
        self.assertTrue(self.conn.settings.force_shading)
        before = self.conn.settings.all()
        self.assertNotEqual(lecturer.steer("stiffness_n_per_mm", 1.0), "")
        self.assertNotEqual(watcher.steer("isovalue", 0.5), "")
        self.assertEqual(self.conn.settings.all(), before)
        self.assertTrue(wait_until(lambda: any("lecturer-1" in line and "isovalue" in line
                                               for line in self.gateway.said)))


    def test_all_who_are_logged_in_may_stop(self):
        watcher, lecturer = self.guest(), self.guest(token=self.token)
        for guest in (watcher, lecturer):
            self.assertTrue(guest.wait_for("hello")["may_stop"])
            self.conn.device.enable()
            self.assertEqual(guest.steer("stop", 0), "")
            self.assertEqual(self.conn.device.info().forces.reason, "stop-call")
        # Told at most once a second; each of them acts.
        lecturer.wait_for("steering", lambda message: any(
            change["key"] == "stop" and change["user"].startswith("guest-")
            for change in message["changes"]))
        for _ in range(5):
            self.assertEqual(lecturer.steer("stop", 0), "")
        self.assertLess(sum("stops the forces" in line for line in self.gateway.said), 5)
        self.conn.device.enable()


    def test_changes_of_two_users_are_each_set_and_shown(self):
        users = [self.guest(token=token) for token in (self.token, self.other)]
        self.daemon.stand_still()
        try:
            for value in range(3):
                for number, user in enumerate(users):
                    user.send({"type": "steer", "id": 1, "key": "isovalue",
                               "value": value / 10 + number / 20})
        finally:
            self.daemon.process.send_signal(signal.SIGCONT)
        for user in users:
            self.assertEqual(user.wait_for("steered")["error"], "")

        def last(message):
            return {change["user"]: change["value"] for change in message["changes"]
                    if change["key"] == "isovalue"}
        users[0].wait_for("steering", lambda message: last(message) == {
            "lecturer-1": 0.2, "lecturer-2": 0.25})


class Options(unittest.TestCase):
    def test_a_room_to_receive_or_publish_replaces_that_of_the_file(self):
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        (folder / "index.html").touch()
        file = folder / "web.toml"
        file.touch(0o600)
        for key, option in (("publish", "--from"), ("from", "--publish")):
            file.write_text(f'nats = {{{key} = "nats://127.0.0.1:1", room = "hall"}}\n')
            check = subprocess.run(
                [PALPATE_WEB, "--check-config", "--config", str(file), "--page", str(folder), option,
                 "nats://127.0.0.1:2"], capture_output=True, text=True, check=False)
            self.assertEqual((check.returncode, check.stderr), (0, ""), option)


class Losses(unittest.TestCase):
    def test_a_key_that_is_in_a_file_is_not_printed(self):
        with Daemon("builtin:sphere:20") as daemon:
            file = daemon.folder / "room-key"
            file.write_text("0123456789abcdef")
            file.chmod(0o600)
            with Gateway(daemon, ("--room-key-file", str(file))) as gateway:
                self.assertNotIn("0123456789abcdef", gateway.link)
                with self.assertRaises(RuntimeError):
                    Guest(gateway, room="0123456789abcdee")
                Guest(gateway, room="0123456789abcdef").close()

    def test_the_gateway_raises_its_limit_of_files(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        with Daemon("builtin:sphere:20") as daemon:
            resource.setrlimit(resource.RLIMIT_NOFILE, (min(256, hard), hard))
            try:
                gateway = self.enterContext(Gateway(daemon))
            finally:
                resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            self.assertEqual(resource.prlimit(gateway.process.pid, resource.RLIMIT_NOFILE),
                             (hard, hard))

    def test_everything_comes_back_after_palpated_was_killed(self):
        with Daemon("builtin:sphere:20") as daemon, Gateway(daemon) as gateway, \
                Guest(gateway) as guest:
            guest.wait_for("manifest")
            guest.wait_for("connection", lambda message: message["state"] == "connected")
            self.assertTrue(wait_until(lambda: guest.pose is not None))
            self.assertTrue(guest.pose.fresh)
            with daemon.connect() as conn:
                conn.recording.start(str(daemon.folder / "lost.mcap"))
            guest.wait_for("recording", lambda recording: recording.running)
            daemon.end(signal.SIGKILL)
            guest.wait_for("connection", lambda message: message["state"] == "lost"
                           and message["why"])
            # The log says where palpated was looked for, guests are not told.
            self.assertTrue(wait_until(lambda: any(daemon.socket in line
                                                   for line in gateway.said)))
            self.assertNotIn(daemon.socket, str(guest.topics))
            self.assertTrue(wait_until(lambda: not guest.pose.fresh))
            self.assertEqual(gateway.ask("GET", "/health")[0], 503)
            guest.wait_for("recording", lambda recording: not recording.running)
            # What guests saw last is still there.
            self.assertIsNotNone(guest.blob(guest.topics["manifest"]["name"]))
            daemon.start()
            guest.wait_for("connection", lambda message: message["state"] == "connected")
            self.assertTrue(wait_until(lambda: guest.pose.fresh))
            self.assertTrue(wait_until(lambda: gateway.ask("GET", "/health")[0] == 200))
            with daemon.connect() as conn:
                conn.edit.sphere((10, 10, 10), 3.0, "add", 0.01, frame="index")
                revision = conn.volume.info().volume_revision
            guest.wait_for("manifest", lambda message: message["revision"] == revision)
            self.assertGreater(guest.pose.pose.tick, 0)

    def test_another_role_of_the_gateway_is_no_loss(self):
        with Daemon("builtin:sphere:20", listen=f"127.0.0.1:{free_port()}",
                    config={"server": ['loopback_role = "viewer"']}) as daemon, \
                Gateway(None, ["--server", f"127.0.0.1:{daemon.port}"]) as gateway, \
                Guest(gateway) as guest:
            with daemon.connect() as conn:
                conn.recording.start(str(daemon.folder / "goes_on.mcap"))
            guest.wait_for("recording", lambda recording: recording.running)
            heard = len(guest.heard)
            config = daemon.folder / "palpated.toml"
            config.write_text(config.read_text().replace('"viewer"', '"editor"'))
            daemon.process.send_signal(signal.SIGHUP)
            self.assertTrue(wait_until(lambda: "warning" in "".join(gateway.said)))
            self.assertNotIn("does not tell", "".join(gateway.said))
            self.assertTrue(all(message["fact"].running for message in guest.heard[heard:]
                                if message["type"] == "recording"))

    def test_voxels_come_without_a_name_while_facts_are_refused(self):
        with Daemon("builtin:sphere:20", config={"limits": ["pose_streams = 1"]}) as daemon, \
                daemon.connect() as conn:
            facts = conn.facts()
            next(facts)
            with Gateway(daemon) as gateway, Guest(gateway) as guest:
                guest.wait_for("manifest")
                self.assertEqual(guest.wait_for("volume").name, "")
                facts.close()
                guest.wait_for("volume", lambda message: message.name)

    def test_the_gateway_starts_without_palpated_and_ends_in_order(self):
        with Daemon("builtin:sphere:20") as daemon:
            daemon.end()
            with Gateway(daemon) as gateway:
                with Guest(gateway) as guest:
                    guest.wait_for("connection", lambda message: message["state"] == "lost")
                    self.assertEqual(guest.wait_for("volume").name, "")
                    self.assertFalse(guest.wait_for("copy")["loading"])
                    daemon.start()
                    guest.wait_for("manifest")
                    guest.wait_for("volume", lambda message: message.name)
                self.assertEqual(gateway.end(), 0)


if __name__ == "__main__":
    unittest.main()
