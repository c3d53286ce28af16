"""A gateway that publishes a room on a NATS server, judged by a client that uses no library of NATS
or of ours: the room keeps the daemon's volume, and everything comes back after a loss."""

import json
import pathlib
import socket
import struct
import tempfile
import threading
import time
import unittest

import numpy as np
import xxhash
import zstandard

from palpate._brick_hash import hash_of_bricks
from palpate.v1 import envelope_pb2

import cable
from gateway import Copy, Gateway, Guest
from nats import JETSTREAM, NatsServer
from support import DaemonTest, wait_until

ROOM = "hall"
SITES = '[[site]]\nname = "lab"\nmay_steer = ["isovalue"]\n'


class Publishing(Gateway):
    def __init__(self, daemon, server, config="", more=()):
        super().__init__(daemon, ("--publish", server.url, "--room", ROOM, *more), config)


class Room:
    """What a room keeps, as a guest of tests/support/gateway.py sees a gateway."""

    def __init__(self, client):
        self.client, self._groups = client, {}

    def parted(self, subject):
        """The name of a blob in parts, and its plain bytes; none: of several blobs."""
        first = self.client.kept(ROOM, f"{subject}.0")
        if first is None:
            return None
        name, count = first.data[6:22], struct.unpack_from("<H", first.data, 4)[0]
        parts = [self.client.kept(ROOM, f"{subject}.{number}") for number in range(count)]
        if any(part is None or part.data[6:22] != name for part in parts):
            return None
        for number, part in enumerate(parts):
            if struct.unpack_from("<BxHH", part.data) != (1, number, count):
                raise AssertionError(f"{subject}.{number}: {part.data[:6]}")
        return name.hex(), zstandard.ZstdDecompressor().decompress(
            b"".join(part.data[22:] for part in parts))

    def hashes(self):
        """What the publisher's beat says that it has put."""
        found = {}
        for name in ["volume", "connection", "settings", "steering", "series", "recording", "copy"]:
            subject = name if name == "volume" else f"text.{name}"
            message = self.client.kept(ROOM, subject)
            if message is not None:
                found[name] = xxhash.xxh3_128_hexdigest(
                    b"\1" + f"palpate.{ROOM}.kept.{subject}".encode() + b"\0" + message.data)
        return found

    def blob(self, name):
        return self._groups.get(name)

    def volume(self):
        """Manifest and copy of what the volume's message names; none: it is being replaced."""
        message = self.client.kept(ROOM, "volume")
        room = envelope_pb2.RoomVolume.FromString(message.data) if message else None
        if room is None or not room.manifest:
            return None
        found, overview = self.parted("manifest"), self.parted("overview")
        if not found or found[0] != json.loads(room.manifest)["name"]:
            return None
        manifest = json.loads(found[1])
        if not overview or overview[0] != manifest["overview"]["name"]:
            return None
        groups = np.prod([-(-axis // 32) for axis in manifest["lattice"]["size"]])
        self._groups = {}
        for number in range(int(groups)):
            group = self.client.kept(ROOM, f"group.{number}")
            if group is not None and any(group.data[6:22]):
                self._groups[group.data[6:22].hex()] = \
                    zstandard.ZstdDecompressor().decompress(group.data[22:])
        copy = Copy(self, manifest, {})
        return None if copy.lost else (manifest, copy)

    def wait_for_volume(self, revision=0):
        """Of this revision or a later one, whole, and the one that the daemon says it is."""
        found = []

        def is_there():
            now = self.volume()
            if now is not None and now[0]["revision"] >= revision:
                found.append(now)
            return bool(found)

        if not wait_until(is_there):
            raise AssertionError(f"the room does not keep revision {revision}")
        manifest, copy = found[0]
        halves = hash_of_bricks(np.arange(len(copy.bricks)), copy.bricks)
        if b"".join(int(half).to_bytes(8, "big") for half in halves).hex() != \
                manifest["content_hash"]:
            raise AssertionError("the room's voxels are not the daemon's")
        return manifest


def kept_facts(client, topic):
    """None of them: nothing is kept there."""
    kept = client.kept(ROOM, f"text.{topic}")
    return envelope_pb2.Envelope.FromString(kept.data if kept else b"").facts


class Cable:
    """To a server: the connections of voxels break after so many bytes on the way there."""

    def __init__(self, server, most):
        self._server, self._most = server, most
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"nats://127.0.0.1:{self._listener.getsockname()[1]}"
        self.breaks = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self._server.port))
            for way in ((near, far, self._most), (far, near, None)):
                threading.Thread(target=self._pass, args=way, daemon=True).start()

    def _pass(self, source, sink, most):
        passed, may_break = 0, False
        try:
            while data := source.recv(4096):
                passed += len(data)
                may_break = may_break or (most is not None and b"volume of room" in data)
                if may_break and passed > most:
                    time.sleep(0.1)  # answers come back
                    self.breaks += 1
                    break
                sink.sendall(data)
        except OSError:
            pass
        for end in (source, sink):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
        source.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()


class RoomTest(DaemonTest):
    def setUp(self):
        self.server = self.enterContext(NatsServer())

    def serve(self, config):
        self.server.end()
        self.server.configure(config)
        self.server.start()

    def join(self, *arguments, **named):
        return self.enterContext(self.server.client(*arguments, **named))

    def publish(self, by=None, **named):
        return self.enterContext(Publishing(self.daemon, by or self.server, **named))

    @staticmethod
    def lines(gateway):
        return [line for line in gateway.said if f"room {ROOM} " in line]

    def wait_for_line(self, gateway, words):
        self.assertTrue(wait_until(lambda: any(words in line for line in self.lines(gateway))),
                        self.lines(gateway))

    def wait_for_other_than(self, data, client, subject):
        """Nothing at all does not count: a room is emptied before it is published anew."""
        self.assertTrue(wait_until(lambda: (kept := client.kept(ROOM, subject))
                                   and kept.data != data), subject)


class PublisherTest(RoomTest):
    volume = "builtin:bumps:50"
    carved = 0

    def carve(self):
        """The volume's revision afterwards."""
        self.carved += 1
        self.conn.edit.sphere((20, 20, 20), 4.0, "set", 0.1 + 0.01 * self.carved, frame="index")
        return self.conn.volume.info().volume_revision

    def test_keeps_the_volume_with_its_changes_and_sends_poses(self):
        client = self.join()
        poses = client.subscribe(f"palpate.{ROOM}.live.pose")
        beats = client.subscribe(f"palpate.{ROOM}.live.beat")
        guest = self.enterContext(Guest(self.publish()))
        room = Room(client)
        before = room.wait_for_volume()
        after = room.wait_for_volume(self.carve())
        self.assertNotEqual(before["content_hash"], after["content_hash"])
        for pose in poses.wait(20)[:20]:
            self.assertGreater(envelope_pb2.Envelope.FromString(pose.data).pose.tick, 0)
            self.assertLess(len(pose.data), 400)
        beat = beats.wait(2)[0].json
        self.assertEqual([beat["protocol"], len(beat["session"]), len(beat["machine"])], [2, 16, 32])
        self.assertTrue(wait_until(lambda: beats.newest.json["kept"] == room.hashes()))
        self.assertTrue(wait_until(
            lambda: client.kept(ROOM, "text.connection").json["state"] == "connected"))
        self.assertTrue(kept_facts(client, "settings").HasField("settings"))
        self.assertEqual(guest.wait_for("guests")["count"], 1)  # the room is none
        # Nothing more than the newest: no message of a subject is kept twice.
        state = client.stream(ROOM)["state"]
        self.assertEqual(state["messages"], state["num_subjects"])

    def test_publishes_anew_what_a_restarted_server_lost(self):
        self.publish()
        Room(self.join()).wait_for_volume()
        for _ in range(2):
            self.server.kill()
            revision = self.carve()
            self.server.start()
            client = self.join()
            Room(client).wait_for_volume(revision)
            self.assertTrue(wait_until(lambda: client.kept(ROOM, "text.settings")))

    def test_publishes_anew_what_was_purged_or_deleted(self):
        self.publish()
        client = self.join()
        room = Room(client)
        room.wait_for_volume()
        stream = client.stream(ROOM)["config"]["name"]
        count = client.stream(ROOM)["state"]["messages"]

        def purge():
            client.request(f"$JS.API.STREAM.PURGE.{stream}", "{}")

        def delete_half():
            state = client.stream(ROOM)["state"]
            for sequence in range(state["first_seq"], state["last_seq"] + 1, 2):
                client.request(f"$JS.API.STREAM.MSG.DELETE.{stream}", json.dumps({"seq": sequence}))

        for harm in (purge, delete_half):
            harm()
            self.assertLess(client.stream(ROOM)["state"]["messages"], count)
            self.assertTrue(wait_until(
                lambda: client.stream(ROOM)["state"]["messages"] == count), harm)
            room.wait_for_volume()

    def test_groups_that_a_smaller_volume_lacks_are_background(self):
        self.publish()
        client = self.join()
        before = Room(client).wait_for_volume()
        held = client.kept(ROOM, "group.7").data
        self.assertTrue(any(held[6:22]) and len(held) > 22)
        self.addCleanup(self.daemon.palpate, "load", self.volume, "--discard")
        self.daemon.palpate("load", "builtin:bumps:20", "--discard")
        self.wait_for_other_than(held, client, "group.7")
        for number in range(1, 8):
            self.assertTrue(wait_until(lambda: (kept := client.kept(ROOM, f"group.{number}"))
                                       and not any(kept.data[6:])), number)
        self.assertNotEqual(Room(client).wait_for_volume()["content_hash"], before["content_hash"])

    def test_a_volume_is_kept_only_after_all_that_it_names(self):
        self.server.end()
        self.server.configure(JETSTREAM + """
            authorization { users: [ { user: judge, password: j },
                                     { user: or-2, password: p, permissions: { publish: {
                                         allow: ">", deny: "palpate.hall.kept.group.3" } } } ] }""")
        self.server.start()
        password = self.server.folder / "password"
        password.write_text("p")
        password.chmod(0o600)
        client = self.join("judge", "j")
        beats = client.subscribe(f"palpate.{ROOM}.live.beat")
        self.publish(config=f'[nats]\nuser = "or-2"\npassword_file = "{password}"\n')
        # The publisher sends it last of the blobs.
        self.assertTrue(wait_until(lambda: client.kept(ROOM, "manifest.0")))
        beats.wait(len(beats.messages) + 3)
        volume = client.kept(ROOM, "volume")
        self.assertFalse(volume and envelope_pb2.RoomVolume.FromString(volume.data).manifest)

    def test_what_somebody_else_wrote_is_replaced_after_a_connection(self):
        way = self.enterContext(cable.Cable(self.server.port))
        self.publish(by=way)
        client = self.join()
        Room(client).wait_for_volume()
        client.publish(f"palpate.{ROOM}.kept.group.3", b"rubbish")
        client.publish(f"palpate.{ROOM}.kept.text.settings", b"rubbish")
        self.assertEqual(client.kept(ROOM, "group.3").data, b"rubbish")
        way.cut()
        way.is_cut = False
        for subject in ("group.3", "text.settings"):
            self.wait_for_other_than(b"rubbish", client, subject)
        Room(client).wait_for_volume()

    def test_while_another_publishes_it_waits_and_then_publishes_everything_anew(self):
        gateway, client = self.publish(), self.join()
        Room(client).wait_for_volume()
        other = json.dumps({"protocol": 2, "session": "0" * 16, "machine": "0" * 32})
        self.assertTrue(wait_until(lambda: client.publish(f"palpate.{ROOM}.live.beat", other) or any(
            "another gateway publishes" in line for line in gateway.said)))
        client.publish(f"palpate.{ROOM}.kept.group.3", b"the other's")
        self.wait_for_other_than(b"the other's", client, "group.3")
        Room(client).wait_for_volume()

    def test_a_connection_that_is_lost_publishes_nothing_twice(self):
        way = self.enterContext(cable.Cable(self.server.port))
        self.publish(by=way)
        client = self.join()
        Room(client).wait_for_volume()
        groups = client.subscribe(f"palpate.{ROOM}.kept.group.*")
        beats = client.subscribe(f"palpate.{ROOM}.live.beat")
        count = way.connections
        way.cut()
        way.is_cut = False
        self.assertTrue(wait_until(lambda: way.connections >= count + 2))
        beats.wait(len(beats.messages) + 6)
        self.assertEqual(len(groups.messages), 0)

    def test_waits_for_a_server_that_is_away_or_keeps_nothing(self):
        self.server.end()
        self.publish()
        self.server.configure("")
        self.server.start()  # without JetStream
        poses = self.join().subscribe(f"palpate.{ROOM}.live.pose")
        poses.wait(20)
        self.server.end()
        self.server.configure("jetstream { max_memory_store: 8KB, max_file_store: 0 }")
        self.server.start()
        self.join().subscribe(f"palpate.{ROOM}.live.pose").wait(20)
        self.server.end()
        self.server.configure(JETSTREAM)
        self.server.start()
        Room(self.join()).wait_for_volume()

    def test_of_two_publishers_one_waits_and_takes_over(self):
        gateways = [self.publish(config=SITES), self.publish(config=SITES)]
        client = self.join()
        sessions = lambda: {beat.json["session"] for beat in beats.messages[-6:]}
        beats = client.subscribe(f"palpate.{ROOM}.live.beat")
        beats.wait(20)
        self.assertEqual(len(sessions()), 1)
        winner = sessions()
        waits = next(gateway for gateway in gateways
                     if wait_until(lambda: any("another gateway publishes" in line
                                               for line in gateway.said), 3))
        other = gateways[1 - gateways.index(waits)]
        # It alone answers.
        answers = client.subscribe("_INBOX_lab.>")
        for value in (0.41, 0.42, 0.43):
            client.publish(f"palpate.{ROOM}.steer.lab",
                           json.dumps({"user": "ann", "key": "isovalue", "value": value}),
                           "_INBOX_lab.one")
        answers.wait(3)
        time.sleep(0.5)
        self.assertEqual([answer.json["error"] for answer in answers.messages], ["", "", ""])
        volumes = client.subscribe(f"palpate.{ROOM}.kept.volume")
        revision = self.carve()
        Room(client).wait_for_volume(revision)
        beats.wait(len(beats.messages) + 4)
        self.assertEqual(len({volume.data for volume in volumes.messages}), len(volumes.messages))
        other.end()
        self.assertTrue(wait_until(lambda: sessions() and not sessions() & winner))
        revision = self.carve()
        Room(client).wait_for_volume(revision)

    def test_steering_is_bound_to_the_site_and_to_what_it_may_change(self):
        self.publish(config=SITES)
        client = self.join()
        client.subscribe(f"palpate.{ROOM}.live.beat").wait(1)

        def steer(site, **request):
            text = json.dumps(request) if request else "nonsense"
            with self.server.client(inbox=f"_INBOX_{site}") as asker:
                return asker.request(f"palpate.{ROOM}.steer.{site}", text).json["error"]

        self.assertTrue(wait_until(
            lambda: steer("lab", user="ann", key="isovalue", value=0.4) == ""))
        self.assertAlmostEqual(self.conn.settings.isovalue, 0.4)
        for refused in [("lab", {"user": "ann", "key": "stiffness_n_per_mm", "value": 0.1}),
                        ("lab", {"user": "ann@lab", "key": "isovalue", "value": 0.5}),
                        ("lab", {"user": "ann", "key": "isovalue", "value": "0.5"}),
                        ("lab", {"user": "ann", "key": "isovalue"}),
                        ("lab", {}),
                        ("elsewhere", {"user": "ann", "key": "isovalue", "value": 0.5}),
                        ("lab", {"user": "ann", "key": "isovalue", "value": 0.5, "x": "x" * 1024})]:
            self.assertNotEqual(steer(refused[0], **refused[1]), "", refused)
        self.assertAlmostEqual(self.conn.settings.isovalue, 0.4)
        self.assertTrue(wait_until(lambda: any(
            change["user"] == "ann@lab"
            for change in client.kept(ROOM, "text.steering").json["changes"])))
        # An answer goes to the asker's own inbox, whatever else it names.
        overheard = client.subscribe("palpate.other.>")
        client.publish(f"palpate.{ROOM}.steer.lab",
                       json.dumps({"user": "ann", "key": "isovalue", "value": 0.5}),
                       "palpate.other.kept.volume")
        self.assertEqual(steer("lab", user="ann", key="isovalue", value=0.45), "")
        self.assertEqual((overheard.messages, self.conn.settings.isovalue), ([], 0.45))


class FaultTest(RoomTest):
    volume = "builtin:bumps:50"

    def test_keeps_the_room_of_a_stream_that_somebody_deleted(self):
        self.publish()
        client = self.join()
        room = Room(client)
        room.wait_for_volume()
        self.assertTrue(client.request(f"$JS.API.STREAM.DELETE.PALPATE_{ROOM}").json["success"])
        room.wait_for_volume()
        self.assertTrue(wait_until(lambda: client.kept(ROOM, "text.settings")))

    def test_a_room_without_its_connection_of_voxels_is_not_published(self):
        cable = self.enterContext(Cable(self.server, 0))
        gateway = self.publish(by=cable)
        self.assertTrue(wait_until(lambda: cable.breaks > 2))
        self.wait_for_line(gateway, "NATS is not reached")

    def test_what_the_server_refuses_is_logged_seldom_and_is_no_state(self):
        password = self.server.folder / "password"
        password.write_text("p")
        password.chmod(0o600)
        config = f'[nats]\nuser = "p"\npassword_file = "{password}"\n{SITES}'
        users = """
authorization { users = [
            {user: lab, password: p},
            {user: p, password: p, permissions: {
                publish: [%s"palpate.hall.live.>", "$JS.API.STREAM.*.PALPATE_hall"],
                subscribe: ["palpate.hall.live.beat", "palpate.hall.steer.*", "_INBOX_p.>"]}}]}"""
        self.serve(JETSTREAM + users % '"palpate.hall.kept.>", ')
        gateway = self.publish(config=config)
        client = self.join("lab", "p")
        Room(client).wait_for_volume()
        self.wait_for_line(gateway, "is published")
        for _ in range(8):
            client.publish(f"palpate.{ROOM}.steer.lab", "{}", "_INBOX_lab.refused")
        time.sleep(2.5)
        # A slow start has another line before.
        self.assertTrue(self.lines(gateway)[-1].endswith("is published\n"))
        client.close()
        gateway.end()
        self.serve(JETSTREAM + users % "")
        gateway = self.publish(config=config)
        self.assertTrue(wait_until(lambda: self.lines(gateway)))
        time.sleep(5)
        self.assertEqual(len(self.lines(gateway)), 1)
        self.assertIn("is not published", self.lines(gateway)[0])


class VolumesTest(RoomTest):
    """Of voxels that do not compress."""

    @classmethod
    def setUpClass(cls):
        folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        voxels = np.random.default_rng(1)
        for name, edge in (("small", 32), ("large", 96)):
            (folder / f"{name}.nrrd").write_bytes(
                b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: %d %d %d\nencoding: raw\n\n" %
                (edge, edge, edge) + voxels.bytes(edge ** 3))
        cls.folder = folder
        cls.volume = str(folder / "large.nrrd")
        super().setUpClass()

    def load(self, name):
        self.daemon.palpate("load", str(self.folder / f"{name}.nrrd"), "--discard")

    def setUp(self):
        super().setUp()
        self.load("large")

    def test_of_a_volume_that_is_too_large_the_texts_are_kept_and_a_smaller_one_heals(self):
        self.serve("jetstream { max_memory_store: 600KB, max_file_store: 0 }")
        gateway = self.publish()
        self.wait_for_line(gateway, "insufficient")
        client = self.join()
        self.conn.settings.isovalue = 77.0
        self.assertTrue(wait_until(
            lambda: kept_facts(client, "settings").settings.settings.isovalue == 77.0))
        self.assertIsNone(client.kept(ROOM, "volume"))
        problem = lambda: client.kept(ROOM, "text.copy").json["problem"]
        self.assertTrue(wait_until(problem))
        self.load("small")
        Room(client).wait_for_volume()
        self.assertTrue(wait_until(lambda: not problem()))

    def test_a_new_publisher_keeps_its_own_volume_alone(self):
        client = self.join()
        volumes = client.subscribe(f"palpate.{ROOM}.kept.volume")
        gateway = self.publish()
        Room(client).wait_for_volume()
        self.assertTrue(client.kept(ROOM, "group.26"))
        gateway.process.kill()
        self.load("small")
        self.publish()
        volumes.wait(2)
        rooms = [envelope_pb2.RoomVolume.FromString(message.data) for message in volumes.messages]
        self.assertEqual({json.loads(room.manifest)["type"] for room in rooms}, {"manifest"})
        Room(client).wait_for_volume()
        groups = [number for number in range(27) if client.kept(ROOM, f"group.{number}")]
        self.assertEqual(groups, [0])

    def test_a_link_that_breaks_now_and_then_publishes_everything(self):
        # Less than the volume and its overview are together.
        cable = self.enterContext(Cable(self.server, 1_200_000))
        self.publish(by=cable)
        Room(self.join()).wait_for_volume()
        self.assertGreater(cable.breaks, 0)

    def test_names_a_message_that_is_too_long_for_the_server(self):
        self.serve(JETSTREAM + "\nmax_payload: 20000")
        gateway = self.publish()
        self.wait_for_line(gateway, "max_payload")


if __name__ == "__main__":
    unittest.main()
