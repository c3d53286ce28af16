"""A daemon for tests that call it by plain gRPC."""

import pathlib
import tempfile
import unittest

import grpc

from palpate.v1 import device_pb2, geometry_pb2
from support import Client, Daemon

BAD, ABORTED = grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.ABORTED
EXHAUSTED = grpc.StatusCode.RESOURCE_EXHAUSTED


def vector(x, y, z):
    return geometry_pb2.Vector3(x=x, y=y, z=z)


def spoilt(message, **changes):
    """A copy with other fields; `a__b` is b of a, and None takes a field out."""
    copy = type(message)()
    copy.CopyFrom(message)
    for path, value in changes.items():
        *parents, name = path.split("__")
        at = copy
        for parent in parents:
            at = getattr(at, parent)
        if value is None:
            at.ClearField(name)
        elif hasattr(value, "CopyFrom"):
            getattr(at, name).CopyFrom(value)
            getattr(at, name).SetInParent()
        else:
            setattr(at, name, value)
    return copy


class CallsTest(unittest.TestCase):
    """One daemon for all tests of a class, with a configuration of `config`."""

    volume = "builtin:bumps:64"
    config = ""

    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(
            tempfile.TemporaryDirectory(prefix="palpate-calls-"))).resolve()
        config = cls.root / "palpated.toml"
        config.write_text(cls.config.format(root=cls.root))
        cls.daemon = cls.enterClassContext(
            Daemon(cls.volume, more=["--config", str(config), "--load-folder", "/"]))
        cls.conn = cls.enterClassContext(cls.daemon.connect())
        cls.stubs = cls.enterClassContext(Client(cls.daemon))

    def refused(self, code, call, *arguments):
        """Makes a call that is refused so, in one line, which it returns."""
        with self.assertRaises(grpc.RpcError) as caught:
            answer = call(*arguments)
            if hasattr(answer, "__next__"):
                list(answer)
        self.assertEqual(caught.exception.code(), code, caught.exception.details())
        self.assertNotIn("\n", caught.exception.details())
        return caught.exception.details()

    def ticks(self):
        return self.stubs.device.GetDevice(device_pb2.GetDeviceRequest()).servo.ticks
