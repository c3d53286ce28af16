"""What a room's users may do at a real nats-server, with the accounts as `palpate-web nats-user`
prints them: a receiver watches its room and steers as itself, and nothing else that it sends has an
effect on any room."""

import itertools
import json
import pathlib
import random
import re
import subprocess
import tempfile
import unittest

from gateway import PALPATE_WEB, Gateway, Guest
from nats import JETSTREAM, NatsServer
from support import Daemon, wait_until

# One of each kind of subject that a room has.
SUBJECTS = ["live.pose", "live.beat", "kept.volume", "kept.text.settings", "kept.manifest.0",
            "kept.overview.0", "kept.group.0", "steer.good", "steer.other"]
API = ["INFO", "STREAM.NAMES", "STREAM.LIST",
       *(f"{call}.PALPATE_ROOM" for call in (
           "STREAM.CREATE", "STREAM.UPDATE", "STREAM.INFO", "STREAM.PURGE", "STREAM.DELETE",
           "STREAM.MSG.GET", "STREAM.MSG.DELETE", "STREAM.SNAPSHOT", "STREAM.RESTORE",
           "STREAM.PEER.REMOVE", "STREAM.LEADER.STEPDOWN", "CONSUMER.CREATE", "CONSUMER.NAMES",
           "CONSUMER.LIST", "DIRECT.GET")),
       *(f"{call}.PALPATE_ROOM.it" for call in (
           "CONSUMER.CREATE", "CONSUMER.DURABLE.CREATE", "CONSUMER.INFO", "CONSUMER.DELETE",
           "CONSUMER.MSG.NEXT"))]
CONSUMER = json.dumps({"stream_name": "PALPATE_hall", "config": {
    "deliver_subject": "palpate.other.kept.volume", "ack_policy": "none", "deliver_policy": "all"}})


def made_user(name, room, *more):
    """Password, and the lines for the server."""
    text = subprocess.run([PALPATE_WEB, "nats-user", name, "--room", room, *more], check=True,
                          capture_output=True, text=True).stdout
    comment, _, lines = text.partition("\n")
    return comment.split()[-1], lines


def stream(room):
    return json.dumps({
        "name": f"PALPATE_{room}", "subjects": [f"palpate.{room}.kept.>"], "storage": "memory",
        "retention": "limits", "discard": "old", "max_msgs_per_subject": 1, "max_consumers": 1,
        "num_replicas": 1, "allow_direct": True})


class Permissions(unittest.TestCase):
    """Rooms `hall` and `other`, each with a publisher and what it keeps; receivers `evil` and `good`
    of the hall, and `stranger` of the other room. A judge sees all of the hall's account."""

    @classmethod
    def setUpClass(cls):
        cls.passwords, blocks = {}, []
        for name, room, *more in (("speaker", "hall", "--publishes"), ("evil", "hall"),
                                  ("good", "hall"), ("speaker-2", "other", "--publishes"),
                                  ("stranger", "other")):
            cls.passwords[name], lines = made_user(name, room, *more)
            blocks.append(lines)
        cls.blocks = list(blocks)
        for place, name in ((0, "judge"), (3, "judge-2")):
            blocks[place] = blocks[place].replace(
                "users: [{", f"users: [{{user: {name}, password: j}}, {{", 1)
            cls.passwords[name] = "j"
        cls.server = cls.enterClassContext(
            NatsServer(JETSTREAM + "\naccounts {\n" + "".join(blocks) + "}\n"))
        cls.publishers = {}
        for name, room in (("speaker", "hall"), ("speaker-2", "other")):
            publisher = cls.publishers[room] = cls.enterClassContext(cls.connect(name))
            made = publisher.request(f"$JS.API.STREAM.CREATE.PALPATE_{room}", stream(room)).json
            if "error" in made:
                raise RuntimeError(made)
            for subject in SUBJECTS[2:7]:
                publisher.publish(f"palpate.{room}.kept.{subject[5:]}", json.dumps({"room": room}))
            publisher.flush()

    @classmethod
    def connect(cls, name):
        return cls.server.client(name, cls.passwords[name])

    def client(self, name):
        return self.enterContext(self.connect(name))

    def setUp(self):
        self.evil, self.good, self.judge = map(self.client, ("evil", "good", "judge"))
        self.judge_2, self.stranger = self.client("judge-2"), self.client("stranger")
        self.heard = [client.subscribe(subject) for client, subject in (
            (self.good, "palpate.hall.live.>"), (self.good, "palpate.hall.kept.>"),
            (self.stranger, "palpate.other.live.>"), (self.stranger, "palpate.other.kept.>"),
            (self.publishers["hall"], "palpate.hall.steer.*"),
            (self.publishers["other"], "palpate.other.steer.*"),
            (self.publishers["hall"], "palpate.hall.live.beat"))]
        self.flush()
        self.before = self.states()

    def flush(self):
        for client in (self.evil, self.good, self.judge, self.stranger, *self.publishers.values()):
            self.assertTrue(client.flush())

    def states(self):
        """Of both streams; what a reader moves left out."""
        found = []
        for room, judge in (("hall", self.judge), ("other", self.judge_2)):
            info = judge.stream(room)
            found.append([info[key] for key in ("config", "created", "state")])
        return found

    def settle(self):
        """Until what was sent had its effect: a request after it is answered, by way of the room."""
        for _ in range(3):
            self.flush()
            self.assertIsNotNone(self.evil.kept("hall", "volume"))
            self.assertIsNotNone(self.stranger.kept("other", "volume"))

    def require_nothing_happened(self):
        self.settle()
        self.assertEqual(self.states(), self.before)
        self.assertEqual([message for heard in self.heard for message in heard.messages], [])
        for room, judge in (("hall", self.judge), ("other", self.judge_2)):
            names = judge.request("$JS.API.STREAM.NAMES").json["streams"]
            self.assertEqual(names, [f"PALPATE_{room}"])

    def require_refused(self, *messages):
        """Messages of `evil`: a subject, or a subject, bytes and a subject for the answer."""
        messages = [(message,) if isinstance(message, str) else message for message in messages]
        count = len(self.evil.errors)
        for message in messages:
            self.evil.publish(*message)
        self.assertTrue(self.evil.flush())
        found = [re.search('Permissions Violation for Publish (?:to|with Reply of) "(.*)"', error)
                 for error in self.evil.errors[count:]]
        self.assertEqual([refusal and refusal[1] for refusal in found],
                         [message[2] if message[2:] and message[2].startswith("_R_") else message[0]
                          for message in messages])

    def test_a_receiver_watches_its_room_and_steers_as_itself(self):
        live, kept = self.heard[0], self.heard[1]
        publisher = self.publishers["hall"]
        publisher.publish("palpate.hall.live.pose", b"\0" * 176)
        publisher.publish("palpate.hall.live.beat", "{}")
        publisher.publish("palpate.hall.kept.text.series", '{"type": "series"}')
        self.assertEqual([message.subject for message in live.wait(2)],
                         ["palpate.hall.live.pose", "palpate.hall.live.beat"])
        self.assertEqual(kept.wait()[0].subject, "palpate.hall.kept.text.series")
        answer = self.good.kept("hall", "text.series")
        self.assertEqual((answer.data, answer.headers["Nats-Subject"]),
                         (b'{"type": "series"}', "palpate.hall.kept.text.series"))
        self.assertEqual(self.good.request(
            "$JS.API.DIRECT.GET.PALPATE_hall.palpate.hall.kept.group.99").status, 404)
        requests = publisher.subscribe("palpate.hall.steer.good", lambda request: publisher.publish(
            request.reply, b'{"error": ""}'))
        publisher.flush()
        self.assertEqual(self.good.request("palpate.hall.steer.good", "{}").json, {"error": ""})
        self.assertIsNotNone(requests)
        self.assertEqual((self.good.errors, publisher.errors), ([], []))

    def test_only_the_password_opens(self):
        hashes = re.findall(r'password: "(\$2b\$.*)"', "".join(self.blocks))
        self.assertEqual(len(hashes), 5)
        for user, password in (("evil", hashes[1]), ("evil", ""), ("evil", self.passwords["good"]),
                               ("speaker", self.passwords["evil"]), (None, None)):
            with self.assertRaises(PermissionError):
                self.server.client(user, password)
        for password in self.passwords.values():
            self.assertNotIn(f'"{password}"', "".join(self.blocks))

    def test_a_receiver_publishes_nothing(self):
        self.require_refused(*((f"palpate.{room}.{subject}", b'{"type": "settings"}')
                               for room, subject in itertools.product(("hall", "other"), SUBJECTS)))
        self.require_refused("palpate.other.steer.evil", "palpate.hall.steer.evil.more")
        self.require_nothing_happened()

    def test_a_receiver_uses_no_more_of_jetstream(self):
        self.require_refused(*(
            ("$JS.API." + call.replace("ROOM", room), data, "_INBOX_evil.answer")
            for room, call, data in itertools.product(("hall", "other"), API, ("", CONSUMER, "{}"))))
        self.require_refused(*(
            f"$JS.API.DIRECT.GET.PALPATE_{room}.{subject}"
            for room in ("hall", "other") for subject in (
                "palpate.other.kept.volume", "palpate.hall.live.pose", "other")),
            "$JS.API.DIRECT.GET.PALPATE_other.palpate.hall.kept.volume")
        self.require_nothing_happened()

    def test_a_receiver_reads_neither_another_room_nor_others_answers(self):
        subscriptions = [">", "*.>", "palpate.>", "palpate.*.live.>", "palpate.other.>",
                         "palpate.other.live.pose", "palpate.*.kept.volume", "palpate.hall.>",
                         "palpate.hall.steer.*", "palpate.hall.steer.good", "_INBOX_good.>",
                         "_INBOX_speaker.>", "_INBOX.>", "_R_.>", "$JS.>", "$JS.API.>", "$SYS.>",
                         "$JS.EVENT.>"]
        found = [self.evil.subscribe(subject) for subject in subscriptions]
        self.evil.flush()
        self.assertEqual(len(self.evil.errors), len(subscriptions), self.evil.errors)
        publisher = self.publishers["other"]
        publisher.publish("palpate.other.live.pose", b"\0" * 176)
        publisher.publish("palpate.other.kept.text.settings", '{"room": "other"}')
        self.heard[2].wait()
        self.assertIsNotNone(self.good.kept("hall", "volume"))
        self.settle()
        self.assertEqual([message for one in found for message in one.messages], [])
        self.assertIsNone(self.evil.kept("other", "volume"))

    def test_no_answer_goes_elsewhere(self):
        """Nobody checks where the sender of a request wants the answer."""
        wanted = [f"palpate.{room}.{subject}" for room in ("hall", "other")
                  for subject in SUBJECTS]
        wanted += ["$JS.API." + call.replace("ROOM", room) for room in ("hall", "other")
                   for call in API]
        wanted += ["_INBOX_good.a", "_INBOX_speaker.a"]
        for reply, subject in itertools.product(wanted, ("volume", "group.0", "nothing")):
            self.evil.publish(f"$JS.API.DIRECT.GET.PALPATE_hall.palpate.hall.kept.{subject}", b"",
                              reply)
        self.require_nothing_happened()
        # Nor the publisher's.
        publisher, replies = self.publishers["hall"], []
        publisher.subscribe("palpate.hall.steer.evil", lambda request: (
            replies.append(request.reply), publisher.publish(request.reply, b"{}")))
        publisher.flush()
        heard = self.heard.pop(4)
        for reply in wanted:
            self.evil.publish("palpate.hall.steer.evil", b"{}", reply)
        heard.wait(len(wanted))
        self.assertTrue(all(reply.startswith("_R_.") for reply in replies), replies)
        self.require_nothing_happened()
        self.require_refused(("palpate.hall.steer.evil", b"{}", replies[0]))

    def test_random_requests_change_nothing(self):
        chance = random.Random(41)
        tokens = ["palpate", "hall", "other", "live", "kept", "steer", "volume", "group", "0", "evil",
                  "good", "$JS", "API", "STREAM", "PURGE", "DELETE", "DIRECT", "GET", "PALPATE_hall",
                  "PALPATE_other", "_INBOX_good", "_INBOX_speaker", "_R_", "$SYS", "REQ", "SERVER",
                  "PING", "CONSUMER", "CREATE", "MSG", "text", "settings", "pose", "beat"]

        def subject():
            begin = chance.choice(["", "", "palpate.", "palpate.hall.", "palpate.other.", "$JS.API.",
                                   "$JS.API.DIRECT.GET.PALPATE_hall.palpate.hall.kept."])
            return begin + ".".join(chance.choices(tokens, k=chance.randint(1, 5)))
        for _ in range(5000):
            asked = subject()
            if asked != "palpate.hall.steer.evil":
                self.evil.publish(asked, chance.choice([b"", b"{}", CONSUMER.encode()]),
                                  chance.choice(["", subject()]))
        self.require_nothing_happened()

    def test_a_publisher_touches_its_own_room_alone(self):
        self.evil = self.client("speaker-2")
        self.require_refused(*(f"palpate.hall.{subject}" for subject in SUBJECTS))
        self.require_refused(*("$JS.API." + call.replace("ROOM", "hall") for call in API))
        self.require_refused(*("$JS.API." + call.replace("ROOM", "other") for call in API if call
                               not in ("STREAM.CREATE.PALPATE_ROOM", "STREAM.PURGE.PALPATE_ROOM")))
        for subject in ("palpate.hall.>", ">", "_INBOX_evil.>"):
            self.evil.subscribe(subject)
        count = len(self.evil.errors)
        self.evil.flush()
        self.assertEqual(len([error for error in self.evil.errors if "Subscription" in error]), 3,
                         self.evil.errors[count:])
        self.evil = self.client("evil")
        self.require_nothing_happened()


class Gateways(unittest.TestCase):
    """They need no more than their users may."""

    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        accounts = "".join(self.account(name, *more) for name, *more in (
            ("speaker", "--publishes"), ("lyon",), ("rome",)))
        self.server = self.enterContext(
            NatsServer(JETSTREAM + "\naccounts {\n" + accounts + "}\n"))

    def account(self, name, *more):
        password, lines = made_user(name, "hall", *more)
        (self.folder / name).touch(0o600)
        (self.folder / name).write_text(password + "\n")
        return lines

    def gateway(self, daemon, name, config=""):
        return self.enterContext(Gateway(
            daemon, ("--publish" if daemon else "--from", self.server.url, "--room", "hall"),
            f'[nats]\nuser = "{name}"\npassword_file = "{self.folder / name}"\n{config}'))

    def test_guests_elsewhere_watch_and_steer(self):
        text = subprocess.run([PALPATE_WEB, "user", "ada", "--may-steer", "isovalue", "--may-steer",
                               "stiffness_n_per_mm"], check=True, capture_output=True, text=True)
        comment, _, user = text.stdout.partition("\n")
        daemon = self.enterContext(Daemon("builtin:sphere:20"))
        self.gateway(daemon, "speaker", '[[site]]\nname = "lyon"\nmay_steer = ["isovalue"]\n')
        lyon, rome = (self.gateway(None, name, user) for name in ("lyon", "rome"))
        guests = [self.enterContext(Guest(gateway, token=comment.split()[-1]))
                  for gateway in (lyon, rome)]
        for guest in guests:
            guest.wait_for("connection", lambda message: message["state"] == "connected")
            self.assertIsNotNone(guest.blob(guest.wait_for("manifest")["name"]))
            self.assertTrue(wait_until(lambda: guest.pose is not None))
        self.assertEqual(guests[0].steer("isovalue", 0.25), "")
        change = guests[1].wait_for("steering", lambda message: message["changes"])["changes"][-1]
        self.assertEqual((change["user"], change["value"]), ("ada@lyon", 0.25))
        self.assertNotEqual(guests[0].steer("stiffness_n_per_mm", 0.1), "")
        self.assertNotEqual(guests[1].steer("isovalue", 0.5), "")
        with daemon.connect() as conn:
            self.assertEqual(conn.settings.isovalue, 0.25)


if __name__ == "__main__":
    unittest.main()
