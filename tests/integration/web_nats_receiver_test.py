"""palpate-web --from: guests of a room of a NATS server. A raw client plays the publisher."""

import json
import pathlib
import random
import signal
import subprocess
import tempfile
import time
import unittest

import numpy as np

from palpate.v1 import facts_pb2

from cable import Cable
from free_port import free_port
from gateway import PALPATE_WEB, Copy, Gateway, Guest
from nats import JETSTREAM, NatsServer
from played_room import ROOM, Publisher, Volume, envelope_of, noise
from support import wait_until


def from_room(server, *more, config=""):
    return Gateway(None, ("--from", server.url, "--room", ROOM, *more), config=config)


class ReceiverTest(unittest.TestCase):
    def await_connection(self, guest, state, *words):
        """Its `why` has one of the words."""
        return guest.wait_for("connection", lambda message: message["state"] == state and (
            not words or any(word in message["why"] for word in words)))

    def assert_shown(self, guest, volume):
        guest.wait_for("manifest", lambda message: message["name"] == volume.name)
        manifest = json.loads(guest.blob(volume.name))
        copy = Copy(guest, manifest, {})
        self.assertFalse(copy.lost)
        np.testing.assert_array_equal(copy.voxels, volume.voxels)
        return manifest


class Room(ReceiverTest):
    def setUp(self):
        self.server = self.enterContext(NatsServer())

    def test_a_late_gateway_has_all_that_the_room_keeps_and_then_follows(self):
        first, second = Volume(noise(1), 7), Volume(noise(2), 8, "next.nrrd")
        with Publisher(self.server) as publisher:
            publisher.show(first)
            steering = {"changes": [{"user": "a@b", "key": "isovalue", "value": 1, "time_ms": 2}]}
            publisher.text("steering", **steering)
            kept = facts_pb2.Facts(
                settings={"settings_revision": 3, "settings": {"isovalue": 2.5}},
                series={"frames": 5, "position_frames": 1, "playing": True, "rate_hz": 2},
                recording={"running": True, "ticks": 1000, "path": "/secret.mcap"})
            for fact, told in kept.ListFields():
                publisher.fact(fact.name, told)
            publisher.client.flush()
            with from_room(self.server) as gateway, Guest(gateway) as guest:
                self.assertEqual(self.await_connection(guest, "connected")["palpated"],
                                 "theatre-2")
                self.assertGreater(guest.topics["connection"]["since_ms"], 1e12)
                self.assert_shown(guest, first)
                self.assertEqual(guest.topics["volume"].name, "made.nrrd")
                self.assertEqual(guest.topics["placement"].settings_revision, 7)
                guest.wait_for("steering", lambda now: now == {"type": "steering"} | steering)
                kept.recording.ClearField("path")  # guests do not see it, whoever sends it
                for fact, told in kept.ListFields():
                    guest.wait_for(fact.name, lambda message: message == told)
                self.assertEqual(gateway.ask("GET", "/health")[0], 200)
                publisher.show(second)
                self.assert_shown(guest, second)
                self.assertEqual(guest.topics["volume"].name, "next.nrrd")
                self.assertIsNotNone(guest.blob(first.name))  # a page may be fetching it
                publisher.settings(4)
                guest.wait_for("settings", lambda message: message.settings_revision == 4)
                guest.wait_for("copy", lambda message: message["bricks_left"] == 0)
                publisher.text("copy", bricks_left=7, problem="40 %", loading=True)
                guest.wait_for("copy", lambda message: message == {
                    "type": "copy", "bricks_left": 0, "problem": "40 %", "loading": True})

    def test_poses_go_on_with_this_gateways_times(self):
        with Publisher(self.server) as publisher, from_room(self.server) as gateway, \
                Guest(gateway) as guest:
            self.await_connection(guest, "connected")
            self.assertTrue(wait_until(lambda: guest.poses > 3))
            pose = guest.pose
            self.assertEqual((pose.pose.hip_mm.y, pose.pose.isovalue, pose.fresh), (2.0, 0.5, True))
            self.assertGreaterEqual(pose.age_ms, 2)
            self.assertAlmostEqual(1e-6 * pose.pose.time_ns + pose.age_ms, pose.sent_ms, delta=1e-3)

    def test_a_pose_of_another_machine_has_no_age(self):
        with Publisher(self.server, machine="0" * 32), from_room(self.server) as gateway, \
                Guest(gateway) as guest:
            self.assertTrue(wait_until(lambda: guest.poses > 3))
            self.assertFalse(guest.pose.HasField("age_ms"))
            self.assertLessEqual(guest.pose.sent_ms, 1e3 * time.clock_gettime(time.CLOCK_MONOTONIC))

    def test_blobs_of_many_parts_and_the_overview_alone(self):
        overview = noise(3, (96, 96, 128))
        volume = Volume(np.repeat(overview, 2, 0).repeat(2, 1).repeat(2, 2), 9, overview=overview,
                        with_groups=False)
        self.assertGreater(len(volume.overview), 2)
        with Publisher(self.server) as publisher, from_room(self.server) as gateway, \
                Guest(gateway) as guest:
            publisher.show(volume)
            guest.wait_for("manifest", lambda message: message["name"] == volume.name)
            manifest = json.loads(guest.blob(volume.name))
            self.assertEqual(manifest["groups"], "")
            self.assertEqual(guest.blob(manifest["overview"]["name"]), overview.tobytes())

    def test_guests_read_who_is_away(self):
        with from_room(self.server) as gateway, Guest(gateway) as guest:
            self.await_connection(guest, "lost", "publishes")
            self.assertEqual(gateway.ask("GET", "/health")[0], 503)
            with Publisher(self.server) as publisher:
                self.await_connection(guest, "connected")
                self.assertTrue(wait_until(lambda: guest.poses > 0 and guest.pose.fresh))
                since_ms = guest.topics["connection"]["since_ms"]
                publisher.text("connection", state="lost", why="palpated is not reached",
                               palpated="theatre-2", since_ms=5)
                self.await_connection(guest, "lost", "palpated")
                self.assertGreater(guest.topics["connection"]["since_ms"], since_ms)
                publisher.text("connection", state="connected", why="", palpated="theatre-2",
                               since_ms=5)
                self.await_connection(guest, "connected")
                publisher.is_silent = True
                self.await_connection(guest, "lost", "publishes")
                self.assertTrue(wait_until(lambda: not guest.pose.fresh))
                # What guests saw last stays.
                publisher.is_silent = False
                self.await_connection(guest, "connected")
            self.await_connection(guest, "lost", "publishes")
            with Publisher(self.server, protocol=1):
                self.await_connection(guest, "lost", "version")
                poses = guest.poses
                self.assertFalse(wait_until(lambda: guest.poses > poses, 0.5))
            with Publisher(self.server):
                self.await_connection(guest, "connected")
            self.server.kill()
            self.await_connection(guest, "lost", "NATS")
            self.assertNotIn(str(self.server.port), str(guest.topics))

    def test_everything_comes_back_after_the_server_was_killed(self):
        volume = Volume(noise(4), 7)
        with from_room(self.server) as gateway, Guest(gateway) as guest:
            with Publisher(self.server) as publisher:
                publisher.show(volume)
                self.assert_shown(guest, volume)
                self.assertTrue(wait_until(lambda: guest.pose is not None))
                self.server.kill()
                self.await_connection(guest, "lost", "NATS")
                self.assertTrue(wait_until(lambda: not guest.pose.fresh))
                self.assert_shown(guest, volume)
            self.server.start()
            self.await_connection(guest, "lost", "publishes")
            with Publisher(self.server) as publisher:
                self.await_connection(guest, "connected")
                volume = Volume(noise(5), 1)
                publisher.show(volume)
                self.assert_shown(guest, volume)
                self.assertTrue(wait_until(lambda: guest.pose.fresh))

    def test_a_server_that_stands_still_is_lost_until_it_goes_on(self):
        with Publisher(self.server) as publisher, from_room(self.server) as gateway, \
                Guest(gateway) as guest:
            self.await_connection(guest, "connected")
            self.server.stop()
            self.await_connection(guest, "lost")
            self.server.cont()
            self.await_connection(guest, "connected")
            volume = Volume(noise(6), 7)
            publisher.show(volume)
            self.assert_shown(guest, volume)

    def test_a_gateway_that_stood_still_has_the_newest(self):
        self.server.end()
        self.server.configure(JETSTREAM + "\nmax_pending: 2MB\nwrite_deadline: \"1s\"")
        self.server.start()
        with Publisher(self.server) as publisher, from_room(self.server) as gateway, \
                Guest(gateway) as guest:
            publisher.show(Volume(noise(7), 1))
            guest.wait_for("manifest")
            # Made before: the gateway closes guests that were silent for 30 s, also if it stood
            # still itself.
            volumes = [Volume(noise(n, (128, 64, 64)), n) for n in range(2, 60)]
            gateway.process.send_signal(signal.SIGSTOP)
            for volume in volumes:
                publisher.show(volume)
            publisher.settings(60)
            gateway.process.send_signal(signal.SIGCONT)
            self.assert_shown(guest, volume)
            guest.wait_for("settings", lambda message: message.settings_revision == 60)
            self.await_connection(guest, "connected")

    def test_rubbish_changes_nothing(self):
        volume = Volume(noise(8), 7)
        some = random.Random(1)
        with Publisher(self.server) as publisher, from_room(self.server) as gateway, \
                Guest(gateway) as guest:
            publisher.show(volume)
            publisher.settings(3)
            self.assert_shown(guest, volume)
            good = [*volume.groups, *volume.manifest, *volume.overview, volume.message,
                    publisher.pose(1)]
            subjects = [*(f"kept.text.{topic}" for topic in
                          ("connection", "settings", "steering", "series", "recording", "guests")),
                        "kept.volume", "kept.manifest.0", "kept.manifest.99999", "kept.overview.0",
                        "kept.group.1", "kept.group.4294967295", "kept.group.99999999999999999999",
                        "kept.group.-1", "kept.group.x", "kept.x", "live.beat", "live.pose"]
            texts = [b"", b"null", b"[" * 900_000, b"\xff\xfe", b'{"type":"settings","revision":',
                     b'{"type":"guests","count":7}', b'{"type":7}', b'{"protocol":[]}',
                     b'{"volume":"{}","placement":7,"manifest":null}',
                     b'{"type":"settings","x":"' + b"y" * 1_040_000 + b'"}']
            for round_number in range(400):
                data = some.choice(texts + good)
                if data in good:
                    data = bytearray(data)
                    for _ in range(some.randrange(1, 4)):
                        data[some.randrange(min(len(data), 64))] = some.randrange(256)
                    data = bytes(data[:some.choice((len(data), len(data), 5, 22, 40))])
                publisher.client.publish(f"palpate.{ROOM}.{some.choice(subjects)}", data)
            publisher.show(volume)
            publisher.text("connection", state="connected", why="", palpated="theatre-2", since_ms=5)
            publisher.settings(5)
            guest.wait_for("settings", lambda message: message.settings_revision == 5)
            self.await_connection(guest, "connected")
            self.assert_shown(guest, volume)
            self.assertEqual({text["name"] for text in guest.heard if text["type"] == "manifest"},
                             {volume.name})
            self.assertTrue(all(text["count"] == 1 for text in guest.heard
                                if text["type"] == "guests"))
            self.assertIsNone(gateway.process.poll())


class Away(ReceiverTest):
    def test_a_gateway_whose_server_is_away_says_so_and_waits(self):
        with NatsServer(starts=False) as server, from_room(server) as gateway, \
                Guest(gateway) as guest:
            self.assertEqual(gateway.ask("GET", "/")[0], 200)
            self.await_connection(guest, "lost", "NATS")
            self.assertEqual(guest.wait_for("volume").name, "")
            server.start()
            with Publisher(server) as publisher:
                volume = Volume(noise(9), 7)
                publisher.show(volume)
                self.assert_shown(guest, volume)
                self.await_connection(guest, "connected")
            self.assertEqual(gateway.end(), 0)


class Voxels(ReceiverTest):
    def test_poses_go_on_while_the_connection_of_the_voxels_is_lost(self):
        with NatsServer() as server, \
                Cable(server.port, lambda first: b'volume"' in first) as cable, \
                Publisher(server) as publisher, from_room(cable) as gateway, \
                Guest(gateway) as guest:
            first, second = Volume(noise(12), 7), Volume(noise(13), 8)
            publisher.show(first)
            self.assert_shown(guest, first)
            self.await_connection(guest, "connected")
            self.assertEqual(guest.topics["copy"]["problem"], "")
            heard = len(guest.heard)
            cable.cut()
            guest.wait_for("copy", lambda message: "NATS" in message["problem"])
            publisher.show(second)
            poses = guest.poses
            self.assertTrue(wait_until(lambda: guest.poses > poses + 20))
            self.assertTrue(guest.pose.fresh)
            cable.is_cut = False
            self.assert_shown(guest, second)
            guest.wait_for("copy", lambda message: message["problem"] == "")
            whys = [text.get("why", "") for text in guest.heard[heard:]]
            self.assertFalse([why for why in whys if "NATS" in why])


class Asking(ReceiverTest):
    def test_what_the_server_had_not_is_asked_for_again(self):
        volume = Volume(noise(14), 7)
        with NatsServer(JETSTREAM + """
                authorization { users: [
                    { user: here, password: p },
                    { user: away, password: p, permissions: {
                        subscribe: { deny: "palpate.hall.kept.group.1" } } } ] }""") as server, \
                Publisher(server, user="here", password="p") as publisher:
            password = server.folder / "password"
            password.write_text("p")
            password.chmod(0o600)
            for number, group in enumerate(volume.groups):
                if number != 1:
                    publisher.keep(f"group.{number}", group)
            groups, volume.groups = volume.groups, []
            publisher.show(volume)
            with from_room(server, config=f'[nats]\nuser = "away"\n'
                           f'password_file = "{password}"\n') as gateway, Guest(gateway) as guest:
                guest.wait_for("copy", lambda message: message["bricks_left"] == 64)
                self.await_connection(guest, "connected")
                self.assertNotIn("manifest", guest.topics)
                publisher.keep("group.1", groups[1])
                self.assert_shown(guest, volume)


class Reconnected(ReceiverTest):
    def test_what_was_kept_while_the_connection_was_lost_is_asked_for(self):
        with NatsServer() as server, Cable(server.port) as cable, Publisher(server) as publisher, \
                from_room(cable) as gateway, Guest(gateway) as guest:
            publisher.settings(1)
            guest.wait_for("settings")
            self.await_connection(guest, "connected")
            cable.cut()
            # No beat says so.
            publisher.client.publish(f"palpate.{ROOM}.kept.text.settings",
                                     envelope_of("settings", {"settings_revision": 2}))
            publisher.client.flush()
            cable.is_cut = False
            guest.wait_for("settings", lambda message: message.settings_revision == 2)


class Site(ReceiverTest):
    def test_what_was_lost_between_two_servers_comes_by_itself(self):
        leaves = free_port()
        # What is asked of JetStream goes on to the hub.
        domain = 'default_js_domain { "$G": "" }'
        with NatsServer(f'{JETSTREAM}\n{domain}\nleafnodes {{ listen: "127.0.0.1:{leaves}" }}') \
                as hub, \
                Cable(leaves) as cable, \
                NatsServer(f"{domain}\nleafnodes {{ reconnect: 1, remotes: [ {{"
                           f' url: "nats://127.0.0.1:{cable.port}" }} ] }}') as site, \
                Publisher(hub) as publisher, from_room(site) as gateway, Guest(gateway) as guest:
            first, second = Volume(noise(10), 7), Volume(noise(11), 8)
            publisher.show(first)
            self.assert_shown(guest, first)
            self.await_connection(guest, "connected")
            cable.cut()
            publisher.show(second)
            publisher.settings(9)
            publisher.client.flush()
            cable.is_cut = False
            self.assert_shown(guest, second)
            guest.wait_for("settings", lambda message: message.settings_revision == 9)


class Steering(ReceiverTest):
    def setUp(self):
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.server = self.enterContext(NatsServer(JETSTREAM + """
            authorization { users: [ { user: away, password: secret1 },
                                     { user: here, password: secret2 } ] }"""))
        password = folder / "password"
        password.write_text("secret1\n")
        password.chmod(0o600)
        text = subprocess.run([PALPATE_WEB, "user", "lecturer-1", "--may-steer", "isovalue"],
                              check=True, capture_output=True, text=True).stdout
        comment, _, user = text.partition("\n")
        nats = f'[nats]\nuser = "away"\npassword_file = "{password}"\n'
        self.gateway = self.enterContext(from_room(self.server, config=nats + user))
        self.lecturer = self.enterContext(Guest(self.gateway, token=comment.split()[-1]))

    def test_the_publisher_decides(self):
        answers = {1.0: b'{"error":""}', 2.0: b'{"error":"at most 1"}', 3.0: b"?", 4.0: b"{}"}
        with Publisher(self.server, user="here", password="secret2") as publisher:
            heard = publisher.client.subscribe(
                f"palpate.{ROOM}.steer.*",
                lambda message: (asked.append((message.subject, message.json)),
                                 publisher.client.publish(
                                     message.reply, answers[message.json["value"]])))
            asked = []
            self.await_connection(self.lecturer, "connected")
            self.assertEqual(self.lecturer.steer("isovalue", 1.0), "")
            self.assertEqual(asked, [(f"palpate.{ROOM}.steer.away",
                                      {"user": "lecturer-1", "key": "isovalue", "value": 1.0})])
            self.assertEqual(self.lecturer.steer("isovalue", 2.0), "at most 1")
            self.assertNotEqual(self.lecturer.steer("isovalue", 3.0), "")
            self.assertNotEqual(self.lecturer.steer("isovalue", 4.0), "")
            self.assertNotEqual(self.lecturer.steer("friction", 1.0), "")  # not the guest's
            self.assertEqual(len(asked), 4)
            self.assertEqual(heard.messages, [])

    def test_without_an_answer_the_change_is_refused(self):
        self.await_connection(self.lecturer, "lost", "publishes")
        self.assertNotEqual(self.lecturer.steer("isovalue", 1.0), "")
        with Publisher(self.server, user="here", password="secret2") as publisher:
            self.await_connection(self.lecturer, "connected")
            self.assertNotEqual(self.lecturer.steer("isovalue", 1.0), "")  # it does not listen
            publisher.client.subscribe(f"palpate.{ROOM}.steer.*")
            publisher.client.flush()
            self.assertNotEqual(self.lecturer.steer("isovalue", 1.0), "")  # nor answer


if __name__ == "__main__":
    unittest.main()
