"""What Python tests share: a palpated of their own, plain clients, its metrics, and volumes."""

import os
import pathlib
import re
import signal
import subprocess
import tempfile
import threading
import time
import unittest
import urllib.request

import grpc
import numpy as np

import palpate
from palpate.v1 import (activity_pb2, device_pb2, device_pb2_grpc, edit_pb2, pose_pb2,
                        pose_pb2_grpc, recording_pb2, recording_pb2_grpc, registration_pb2,
                        registration_pb2_grpc, render_pb2, render_pb2_grpc, series_pb2,
                        series_pb2_grpc, volume_pb2, volume_pb2_grpc)

from crash import end_in_order
from free_port import free_port

PALPATED = os.environ["PALPATED"]
PALPATE = os.environ.get("PALPATE", "")
DOOR = os.environ.get("PALPATE_DOOR", "")
# AddressSanitizer keeps what was freed for a while: its builds say nothing about memory.
SANITIZED = "PALPATE_SANITIZED" in os.environ
PATIENCE_S = 120.0
CALL_S = 60.0
# Every method of every service.
METHODS = [method
           for file in (activity_pb2, device_pb2, pose_pb2, recording_pb2, registration_pb2, render_pb2,
                        series_pb2, volume_pb2)
           for service in file.DESCRIPTOR.services_by_name.values() for method in service.methods]


def bare_call(channel, method):
    """One of METHODS, which takes and gives bytes."""
    kind = "_".join("stream" if streams else "unary"
                    for streams in (method.client_streaming, method.server_streaming))
    return getattr(channel, kind)(f"/{method.containing_service.full_name}/{method.name}")


def wait_until(holds, seconds=PATIENCE_S):
    """Whether it held within that time."""
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


class Daemon:
    """Runs until end() or the end of a `with` block.

    listen: an address, or True for a port of this machine whose clients are operators.
    more: more arguments. config: more lines of TOML by section; without `--config` in `more`,
    clients load from everywhere and save to the daemon's folder. wrapper: a command that runs
    the daemon; `process` is the wrapper's then."""

    def __init__(self, volume="builtin:sphere:48", listen=None, more=(), config=None, wrapper=(),
                 metrics=False, folder=None, state=None):
        self._temporary = tempfile.TemporaryDirectory(prefix="palpate-test-")
        self.folder = pathlib.Path(folder or self._temporary.name)
        self.socket = str(self.folder / "palpated.sock")
        self.metrics_port = free_port() if metrics else None
        sections = {name: list(lines) for name, lines in (config or {}).items()}
        if listen is True:
            listen = f"127.0.0.1:{free_port()}"
            sections.setdefault("server", []).append('loopback_role = "operator"')
        if metrics:
            sections["metrics"] = [f'listen = "127.0.0.1:{self.metrics_port}"']
        self.command = [*wrapper, PALPATED, "--volume", str(volume), "--socket", self.socket,
                        "--state-folder", str(state or self.folder / "state"), *more]
        if listen:
            self.port = int(listen.rpartition(":")[2])
            self.command += ["--listen", listen]
        if "--config" not in more:
            self.command += ["--config", str(self._write_config(sections))]
        self.start()

    def _write_config(self, sections):
        for key, default in (("save_folders", self.folder), ("load_folders", "/")):
            lines = sections.setdefault("volume", [])
            if not any(key in line for line in lines):
                lines.append(f'{key} = ["{default}"]')
        path = self.folder / "palpated.toml"
        path.write_text("".join(f"[{name}]\n" + "\n".join(lines) + "\n"
                                for name, lines in sections.items()))
        return path

    def start(self):
        """Starts it, again after end(), and waits until it is ready."""
        self.process = subprocess.Popen(self.command, cwd=self.folder, stdout=subprocess.DEVNULL,
                                        stderr=subprocess.PIPE, text=True)
        said = self.said = []
        ready = threading.Event()

        def read(lines):
            # To the end: a daemon whose log nobody reads stands still.
            for line in lines:
                said.append(line)
                if "ready on" in line:
                    ready.set()
            ready.set()

        self._reader = threading.Thread(target=read, args=(self.process.stderr,), daemon=True)
        self._reader.start()
        if not ready.wait(PATIENCE_S) or not any("ready on" in line for line in said):
            self.end(signal.SIGKILL)
            raise RuntimeError("palpated did not start: " + "".join(said))

    def stand_still(self):
        """Until SIGCONT. The signal is there before the last thread has stopped."""
        self.process.send_signal(signal.SIGSTOP)
        tasks = pathlib.Path(f"/proc/{self.process.pid}/task")

        def stands():
            return all(stat.read_text().rpartition(")")[2].split()[0] == "T"
                       for stat in tasks.glob("*/stat"))
        if not wait_until(stands):
            raise RuntimeError("palpated does not stop")

    def end(self, number=signal.SIGTERM):
        """The exit status."""
        if self.process.poll() is None:
            self.process.expect(number)
            os.kill(self.pid, number)

        def close():
            self._reader.join(PATIENCE_S)
            self.process.stderr.close()

        return end_in_order(self.process, PATIENCE_S, self.said, close)

    @property
    def pid(self):
        """Of palpated, also below a wrapper."""
        pid = self.process.pid
        while os.path.basename(os.readlink(f"/proc/{pid}/exe")) != os.path.basename(PALPATED):
            children = pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
            if not children:
                raise RuntimeError("palpated is not there")
            pid = int(children[0])
        return pid

    def open_files(self):
        return len(os.listdir(f"/proc/{self.pid}/fd"))

    def resident_bytes(self):
        pages = int(pathlib.Path(f"/proc/{self.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGESIZE")

    def threads(self):
        return len(os.listdir(f"/proc/{self.pid}/task"))

    def connect(self):
        return palpate.connect(self.socket)

    def palpate(self, *arguments, code=0):
        """A command against it, which ends with this code."""
        ran = subprocess.run([PALPATE, *map(str, arguments), "--socket", self.socket],
                             capture_output=True, text=True, timeout=5 * PATIENCE_S, check=False)
        if ran.returncode != code:
            raise AssertionError(f"palpate {arguments}: {ran.returncode} {ran.stderr}")
        return ran

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()
        self._temporary.cleanup()


class DaemonTest(unittest.TestCase):
    """One daemon and one connection for all tests of a class."""

    volume = "builtin:sphere:48"

    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(Daemon(cls.volume))
        cls.conn = cls.enterClassContext(cls.daemon.connect())


class Client:
    """Stubs on a connection of their own."""

    def __init__(self, daemon, tcp=False, target=None, options=()):
        self.channel = grpc.insecure_channel(
            target or (f"127.0.0.1:{daemon.port}" if tcp else f"unix:{daemon.socket}"),
            options=[("grpc.use_local_subchannel_pool", 1),
                     ("grpc.initial_reconnect_backoff_ms", 100),
                     ("grpc.max_reconnect_backoff_ms", 1000), *options])
        self.render = render_pb2_grpc.RenderServiceStub(self.channel)
        self.volume = volume_pb2_grpc.VolumeServiceStub(self.channel)
        self.device = device_pb2_grpc.DeviceServiceStub(self.channel)
        self.poses = pose_pb2_grpc.PoseServiceStub(self.channel)
        self.recording = recording_pb2_grpc.RecordingServiceStub(self.channel)
        self.registration = registration_pb2_grpc.RegistrationServiceStub(self.channel)
        self.series = series_pb2_grpc.SeriesServiceStub(self.channel)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.channel.close()

    def settings(self):
        return self.render.GetSettings(render_pb2.GetSettingsRequest(), timeout=CALL_S)

    def _device(self):
        return self.device.GetDevice(device_pb2.GetDeviceRequest(), timeout=CALL_S)

    def servo(self):
        return self._device().servo

    def force_state(self):
        return self._device().forces.state

    def set_stiffness(self, value):
        request = render_pb2.UpdateSettingsRequest()
        request.settings.stiffness_n_per_mm = value
        request.update_mask.paths.append("stiffness_n_per_mm")
        return self.render.UpdateSettings(request, timeout=CALL_S)

    def carve(self, x, y, z, radius_voxels=3.0):
        request = edit_pb2.EditVolumeRequest(frame=edit_pb2.EDIT_FRAME_INDEX,
                                             operation=edit_pb2.EDIT_OPERATION_ADD, value=0.01)
        request.sphere.radius = radius_voxels
        request.sphere.center.x, request.sphere.center.y, request.sphere.center.z = x, y, z
        return self.volume.EditVolume(request, timeout=CALL_S)

    def record(self, path):
        return self.recording.StartRecording(
            recording_pb2.StartRecordingRequest(path=str(path)), timeout=CALL_S)

    def recorded_ticks(self):
        """That are on the disk."""
        return self.recording.GetRecording(recording_pb2.GetRecordingRequest(),
                                           timeout=CALL_S).recording.ticks

    def read_poses(self, count, rate_hz=1000.0, batch=10):
        """So many messages of a plain stream."""
        start = pose_pb2.StreamPosesRequest()
        start.start.rate_hz = rate_hz
        start.start.batch = batch
        call = self.poses.StreamPoses(iter([start]), timeout=CALL_S)
        messages = [message for message, _ in zip(call, range(count))]
        call.cancel()
        return messages


class StreamReader:
    """Follows a stream on a thread of its own, acknowledging each message, or every so many, until
    stop(). `start`: its first request."""

    def __init__(self, stream, start, acknowledge_every=1):
        self.messages = 0
        self.error = None
        self._next = threading.Semaphore(0)
        self._start = start
        self._acknowledge_every = acknowledge_every
        self._stopped = self._over = False
        self._call = stream(self._requests())
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def take(self, message):
        """Of each message; whether it goes on."""
        return True

    def _requests(self):
        yield self._start
        while True:
            self._next.acquire()
            if self._over:
                return
            request = type(self._start)()
            request.acknowledgement.message_number = self.messages
            yield request

    def _read(self):
        try:
            for message in self._call:
                self.messages = message.message_number
                if not self.take(message):
                    return
                if self.messages % self._acknowledge_every == 0:
                    self._next.release()
            self._end_requests()
        except grpc.RpcError as error:
            if not self._stopped:
                self.error = error
            self._end_requests()

    def _end_requests(self):
        """gRPC waits for their end."""
        self._over = True
        self._next.release()

    def stop(self):
        self._stopped = True
        self._call.cancel()
        self._end_requests()
        self._thread.join(PATIENCE_S)


class PoseReader(StreamReader):
    def __init__(self, client, rate_hz=60.0, batch=1, acknowledge_every=1):
        self.samples = 0
        self.newest = None
        start = pose_pb2.StreamPosesRequest()
        start.start.rate_hz = rate_hz
        start.start.batch = batch
        start.start.max_unacknowledged = 16
        super().__init__(client.poses.StreamPoses, start, acknowledge_every)

    def take(self, message):
        self.samples += len(message.samples)
        self.newest = message.samples[-1]
        return True


def scrape(port):
    """The metrics as text."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=CALL_S) as answer:
        return answer.read().decode()


def parse_metrics(text):
    """({name: (type, help)}, {name with labels: value})."""
    helps = dict(re.findall(r"^# HELP (\S+) (.+)$", text, re.MULTILINE))
    families = {name: (kind, helps[name])
                for name, kind in re.findall(r"^# TYPE (\S+) (\w+)$", text, re.MULTILINE)}
    samples = re.findall(r"^(\w+(?:\{.*\})?) (\S+)$", text, re.MULTILINE)
    values = {key: float(value) for key, value in samples}
    if len(values) != len(samples):
        raise ValueError("a sample is there twice")
    return families, values


def metric(port, key):
    return parse_metrics(scrape(port))[1][key]


def pattern(shape, kind=np.float32):
    """(nx, ny, nz): a value that names its own place, so that no two axes can be confused."""
    i, j, k = np.indices(shape)
    return (10000 * i + 100 * j + k).astype(kind)


def nrrd(values, directions=((1, 0, 0), (0, 1, 0), (0, 0, 1)), origin=(0, 0, 0)):
    """Bytes of an NRRD file of float32, written without the package: x fastest."""
    vectors = " ".join(f"({d[0]!r},{d[1]!r},{d[2]!r})" for d in directions)
    header = ("NRRD0004\ntype: float\ndimension: 3\nspace: left-posterior-superior\n"
              f"sizes: {values.shape[0]} {values.shape[1]} {values.shape[2]}\n"
              f"space directions: {vectors}\n"
              f"space origin: ({origin[0]!r},{origin[1]!r},{origin[2]!r})\n"
              "endian: little\nencoding: raw\n\n")
    return header.encode() + values.astype("<f4").tobytes(order="F")
