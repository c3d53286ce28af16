"""The whole chain of a room on NATS: palpated -> publishing palpate-web -> nats-server -> receiving
palpate-web -> guest. Each part by itself: web_nats_test.py, web_nats_receiver_test.py."""

import json
import signal
import subprocess
import unittest

import numpy as np

from palpate._geometry import matrix_of_map
from palpate._settings import values_of

from gateway import PALPATE_WEB, Copy, Guest
from replayed import differences, record, scene_at, standing
from room import Room, content_hash, hash_of_palpated
from support import wait_until



def made_user(name, *keys):
    """Its token, and its lines of the configuration."""
    steers = [part for key in keys for part in ("--may-steer", key)]
    text = subprocess.run([PALPATE_WEB, "user", name, *steers], check=True, capture_output=True,
                          text=True).stdout
    comment, _, lines = text.partition("\n")
    return comment.split()[-1], lines


class RoomTest(unittest.TestCase):
    def shows(self, guest, wanted):
        """Whether it is shown the volume of this content hash; its copy is that, voxel by voxel."""
        if "manifest" not in guest.topics:
            return False
        blob = guest.blob(guest.topics["manifest"]["name"])
        if blob is None or json.loads(blob)["content_hash"] != wanted:
            return False
        copy = Copy(guest, json.loads(blob), {})
        self.assertTrue(copy.lost or content_hash(copy.voxels) == wanted)
        return not copy.lost

    def require_shown(self, guest, daemon):
        wanted = hash_of_palpated(daemon)
        self.assertTrue(wait_until(lambda: self.shows(guest, wanted)), guest.topics)

    def require_connected(self, guest):
        guest.wait_for("connection", lambda message: message["state"] == "connected")
        before = guest.poses
        self.assertTrue(wait_until(lambda: guest.poses > before + 10 and guest.pose.fresh),
                        guest.topics)

    def test_a_guest_sees_palpateds_volume_poses_and_settings(self):
        with Room(1, {"volume": "builtin:bumps:50"}) as room, room.daemon.connect() as conn, \
                Guest(room.receivers[0]) as guest:
            self.require_shown(guest, room.daemon)
            self.require_connected(guest)
            random = np.random.default_rng(3)
            for _ in range(10):
                conn.edit.sphere(tuple(random.uniform(0, 49, 3)), 4.0, "add", 0.01, frame="index")
            self.require_shown(guest, room.daemon)
            tick = guest.pose.pose.tick
            self.assertTrue(wait_until(lambda: guest.pose.pose.tick > tick))
            conn.settings.isovalue = 0.3
            guest.wait_for("settings", lambda message: message.settings.isovalue == 0.3)
            room.daemon.palpate("load", "builtin:gyroid:33", "--discard")
            guest.wait_for("volume", lambda message: message.name == "builtin:gyroid:33")
            self.require_shown(guest, room.daemon)

    def test_guests_are_shown_the_scene_of_each_tick_of_a_replay(self):
        with Room(1, {"volume": "builtin:gyroid:48"}) as room, room.daemon.connect() as conn, \
                Guest(room.publisher) as near, Guest(room.receivers[0]) as far:
            file = room.daemon.folder / "a.mcap"
            recording = record(conn, file)
            live = conn.settings.all()
            for place in np.random.default_rng(2).integers(0, len(recording.ticks.tick) - 1, 50):
                scene = scene_at(recording, place)
                with self.subTest(place=place), standing(room.daemon, file, int(place)) as pose:
                    for guest in near, far:
                        told = guest.wait_for("settings", lambda message: message.settings_revision
                                              == pose.settings_revision[-1])
                        self.assertTrue(told.replayed)
                        placed = guest.wait_for(
                            "placement", lambda message: message.replayed and np.array_equal(
                                matrix_of_map(message.device_from_index), scene.device_from_index))
                        self.assertEqual(differences(scene, values_of(told.settings),
                                                     matrix_of_map(placed.device_from_index)), [])
                        self.assertEqual(told.ball.felt_radius_mm,
                                         recording.ticks.tool_radius_mm[place])
                        self.assertTrue(wait_until(lambda: guest.pose.pose.replayed))
            for guest in near, far:
                told = guest.wait_for("settings", lambda message: not message.replayed)
                self.assertEqual(values_of(told.settings), live)
                guest.wait_for("placement", lambda message: not message.replayed)

    def test_a_user_of_a_site_steers_what_both_gateways_allow(self):
        token, user = made_user("lecturer", "isovalue", "force_shading")
        with Room(0, {"volume": "builtin:sphere:32"}, steers=["isovalue"]) as room, \
                room.daemon.connect() as conn:
            receiver = room.receive(config=user)
            with Guest(receiver, token=token) as lecturer, Guest(room.publisher) as watcher:
                self.require_connected(lecturer)
                self.assertEqual(lecturer.steer("isovalue", 0.25), "")
                self.assertEqual(conn.settings.isovalue, 0.25)
                change = watcher.wait_for("steering", lambda message: message["changes"])
                self.assertIn("lecturer", change["changes"][-1]["user"])
                self.assertIn(room.sites[0].name, change["changes"][-1]["user"])
                lecturer.wait_for("settings",
                                  lambda message: message.settings.isovalue == 0.25)
                before = conn.settings.all()
                for key, value in (("force_shading", 1), ("stiffness_n_per_mm", 1.0),
                                   ("isovalue", 1e9)):
                    self.assertNotEqual(lecturer.steer(key, value), "")
                self.assertEqual(conn.settings.all(), before)

    def test_everything_comes_back_after_each_was_killed(self):
        with Room(1, {"volume": "builtin:sphere:48"}) as room:
            receiver = room.receivers[0]

            def kill_gateway(gateway):
                gateway.process.kill()
                gateway.end()

            with Guest(receiver) as guest:
                self.require_connected(guest)
                self.require_shown(guest, room.daemon)
                with room.daemon.connect() as conn:
                    conn.recording.start(str(room.daemon.folder / "lost.mcap"))
                guest.wait_for("recording", lambda recording: recording.running)
                for kill, start in (
                        (room.nats.kill, room.nats.start),
                        (lambda: kill_gateway(room.publisher), room.publisher.start),
                        (lambda: room.daemon.end(signal.SIGKILL), room.daemon.start)):
                    kill()
                    guest.wait_for("connection", lambda message: message["state"] == "lost"
                                   and message["why"])
                    self.assertTrue(wait_until(lambda: not guest.pose.fresh))
                    guest.wait_for("recording", lambda recording: not recording.running)
                    # What guests saw last is still there.
                    self.assertIsNotNone(guest.blob(guest.topics["manifest"]["name"]))
                    start()
                    self.require_connected(guest)
                    if start != room.daemon.start:
                        guest.wait_for("recording", lambda recording: recording.running)
                    with room.daemon.connect() as conn:
                        conn.edit.sphere((20, 20, 20), 4.0, "add", 0.01, frame="index")
                    self.require_shown(guest, room.daemon)
            kill_gateway(receiver)
            receiver.start()
            with Guest(receiver) as guest:
                self.require_connected(guest)
                self.require_shown(guest, room.daemon)


if __name__ == "__main__":
    unittest.main()
