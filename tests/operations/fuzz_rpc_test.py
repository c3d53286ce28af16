"""Messages that nobody should send, to every call that there is, of a real palpated.

Messages are made from the descriptors: extreme numbers, paths that lead elsewhere,
unknown enum values, missing parts; then bytes of some are changed, cut or made up. A
fixed seed and some thousand messages; PALPATE_TORTURE times as many in the long run.
After each: palpated lives; the refusal says what was wrong, by its code; and what is
refused has changed nothing."""

import math
import os
import random
import unittest

import grpc
from google.protobuf import message_factory
from google.protobuf.descriptor import FieldDescriptor as Field

from palpate.v1 import recording_pb2, series_pb2, volume_pb2
from support import CALL_S, METHODS, Client, Daemon, bare_call

MESSAGES = 2000 * int(os.environ.get("PALPATE_TORTURE", "1"))
SEED = 8
STREAM_S = 0.2

DOUBLES = [0.0, -0.0, 1.0, -1.0, 0.5, 1e-308, 5e-324, 1e308, -1e308, math.inf, -math.inf, math.nan,
           1e9, -1e9, 3.3, 24.0]
INTEGERS = [0, 1, 2, 3, 7, 64, 65, 255, 256, 2 ** 16, 2 ** 31 - 1, 2 ** 31, 2 ** 32 - 1, 2 ** 32,
            2 ** 53, 2 ** 63 - 1, 2 ** 63, 2 ** 64 - 1, -1, -2 ** 31, -2 ** 63]
TEXTS = ["", "simulated", "stiffness_n_per_mm", "isovalue", "normalized_isovalue", "free_side",
         "settings.stiffness_n_per_mm", "..", "/", "/dev/zero", "/dev/stdin", "/proc/self/mem",
         "/etc/passwd", "../../../../etc/passwd", "builtin:sphere:16", "builtin:sphere:99999999",
         "builtin:sphere:-1", "builtin:", "%s%n%x", "a" * 70000, "\x00", "\x1b[2J\n", "ü\u202e",
         "*", "[" * 300, "v.nrrd", "r.mcap"]
# Of bytes that are no message, gRPC itself says so, with this code.
MALFORMED = {grpc.StatusCode.INTERNAL, grpc.StatusCode.UNKNOWN,
             grpc.StatusCode.UNIMPLEMENTED}  # of calls that gRPC answers by callbacks
ANSWERS = {grpc.StatusCode.OK, grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.NOT_FOUND,
           grpc.StatusCode.ALREADY_EXISTS, grpc.StatusCode.PERMISSION_DENIED,
           grpc.StatusCode.FAILED_PRECONDITION, grpc.StatusCode.ABORTED,
           grpc.StatusCode.OUT_OF_RANGE, grpc.StatusCode.RESOURCE_EXHAUSTED,
           grpc.StatusCode.CANCELLED}
_BITS = {Field.CPPTYPE_INT32: (-2 ** 31, 2 ** 31), Field.CPPTYPE_UINT32: (0, 2 ** 32),
         Field.CPPTYPE_INT64: (-2 ** 63, 2 ** 63), Field.CPPTYPE_UINT64: (0, 2 ** 64)}


class Maker:
    def __init__(self, seed, folder):
        self._random = random.Random(seed)
        self._texts = TEXTS + [f"{folder}/{name}" for name in ("v.nrrd", "r.mcap", "", "no/such")]
        self._factory = message_factory.MessageFactory()

    def method(self):
        return self._random.choice(METHODS)

    def bytes(self, descriptor):
        """(bytes, whether they are a message)."""
        data = self.message(descriptor).SerializeToString()
        kind = self._random.random()
        if kind < 0.7:
            return data, True
        if kind < 0.8:
            return data[:self._random.randrange(len(data) + 1)], False
        if kind < 0.9:
            changed = bytearray(data)
            for _ in range(self._random.randint(1, 8)):
                if changed:
                    changed[self._random.randrange(len(changed))] = self._random.randrange(256)
            return bytes(changed), False
        if kind < 0.95:
            return self._random.randbytes(self._random.choice((1, 9, 100, 5000))), False
        # Groups within groups, as no parser likes them.
        return b"\x0b" * self._random.choice((10, 1000, 100000)), False

    def message(self, descriptor, depth=0):
        message = self._factory.GetPrototype(descriptor)()
        for field in descriptor.fields:
            if self._random.random() < 0.25 + 0.1 * depth:
                continue
            self._fill(message, field, depth)
        return message

    def _fill(self, message, field, depth):
        many = field.label == Field.LABEL_REPEATED
        count = self._random.choice((0, 1, 1, 2, 40)) if many else 1
        for _ in range(count):
            if field.cpp_type == Field.CPPTYPE_MESSAGE:
                part = self.message(field.message_type, depth + 1)
                if many:
                    getattr(message, field.name).append(part)
                else:
                    getattr(message, field.name).CopyFrom(part)
            elif many:
                getattr(message, field.name).append(self._value(field))
            else:
                setattr(message, field.name, self._value(field))

    def _value(self, field):
        pick = self._random.choice
        if field.cpp_type in (Field.CPPTYPE_DOUBLE, Field.CPPTYPE_FLOAT):
            return pick(DOUBLES) if self._random.random() < 0.7 else self._random.uniform(-50, 50)
        if field.cpp_type == Field.CPPTYPE_BOOL:
            return pick((True, False))
        if field.cpp_type == Field.CPPTYPE_ENUM:
            return pick([value.number for value in field.enum_type.values] + [99, -1])
        if field.cpp_type == Field.CPPTYPE_STRING:
            if field.type == Field.TYPE_BYTES:
                return self._random.randbytes(pick((0, 1, 64, 5000)))
            return pick(self._texts)
        low, end = _BITS[field.cpp_type]
        return pick([value for value in INTEGERS if low <= value < end])


def call(channel, method, requests):
    """Sends bytes to a method, whatever they are. The status code and its words."""
    endless = method.client_streaming and method.server_streaming
    sent = iter(requests) if method.client_streaming else requests[0]
    try:
        answer = bare_call(channel, method)(sent, timeout=STREAM_S if endless else CALL_S)
        if method.server_streaming:
            for _, _ in zip(range(50), answer):
                pass
            answer.cancel()
        return grpc.StatusCode.OK, ""
    except grpc.RpcError as error:
        if endless and error.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
            return grpc.StatusCode.OK, ""
        return error.code(), error.details()


class FuzzedServices(unittest.TestCase):
    def setUp(self):
        self.daemon = self.enterContext(Daemon(
            "builtin:sphere:32", config={"volume": ["memory_budget_mib = 64"]}))
        self.client = self.enterContext(Client(self.daemon))

    def state(self):
        """All that a refused call must leave alone."""
        client = self.client
        volume = client.volume.GetVolume(volume_pb2.GetVolumeRequest(), timeout=CALL_S)
        recording = client.recording.GetRecording(recording_pb2.GetRecordingRequest(),
                                                  timeout=CALL_S).recording
        return (client.settings().SerializeToString(deterministic=True),
                volume.SerializeToString(deterministic=True), recording.running, recording.path)

    def plays(self):
        try:
            answer = self.client.series.GetSeries(series_pb2.GetSeriesRequest(), timeout=CALL_S)
        except grpc.RpcError as error:
            self.assertEqual(error.code(), grpc.StatusCode.ABORTED)  # there is none
            return False
        return answer.series.playing

    def test_every_call(self):
        make = Maker(SEED, self.daemon.folder)
        codes, called = {}, set()
        played, state = self.plays(), self.state()
        for number in range(MESSAGES):
            method = make.method()
            made = [make.bytes(method.input_type)
                    for _ in range(3 if method.client_streaming else 1)]
            code, words = call(self.client.channel, method, [data for data, _ in made])
            said = f"message {number}, {method.full_name}: {code} {words}; {made!r:.500}"
            self.assertIsNone(self.daemon.process.poll(), said + "".join(self.daemon.said[-3:]))
            allowed = ANSWERS if all(whole for _, whole in made) else ANSWERS | MALFORMED
            if code in MALFORMED:
                self.assertEqual(words, "", said)  # gRPC says so; we would say why
            self.assertIn(code, allowed, said)
            if code != grpc.StatusCode.OK:
                self.assertTrue(words or code in MALFORMED, said)
                # A series plays on by itself: only what calls change is compared.
                if not played and method.name not in ("LoadSeries", "Replay"):
                    self.assertEqual(self.state(), state, said)
            played, state = self.plays(), self.state()
            codes[code.name] = codes.get(code.name, 0) + 1
            called.add(method.full_name)
        print(f"{MESSAGES} messages to {len(called)} calls: {codes}")
        self.assertEqual(len(called), len(METHODS))
        # Refusals by us, and calls that were taken: neither alone would test much.
        self.assertGreater(codes["INVALID_ARGUMENT"], 0.1 * MESSAGES)
        self.assertGreater(codes["OK"], 0.05 * MESSAGES)
        self.check_served()

    def check_served(self):
        for field, value in self.client.settings().settings.ListFields():
            if field.cpp_type == Field.CPPTYPE_DOUBLE:
                self.assertTrue(math.isfinite(value), field.name)
        with Client(self.daemon, target=f"unix:{self.daemon.socket}") as good:
            self.assertAlmostEqual(good.set_stiffness(0.7).settings.stiffness_n_per_mm, 0.7)
            self.assertEqual(len(good.read_poses(5)), 5)
        self.assertEqual(self.daemon.end(), 0)


if __name__ == "__main__":
    unittest.main()
