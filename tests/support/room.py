"""A room on NATS, of a test's own: palpated -> publishing palpate-web -> nats-server -> receiving
palpate-web. And what its programs take of the machine."""

import contextlib
import os
import pathlib
import subprocess
import tempfile

import numpy as np
import xxhash

from gateway import PALPATE_WEB, Gateway
from nats import JETSTREAM, NatsServer
from support import PATIENCE_S, Client, Daemon, StreamReader
from palpate.v1 import volume_stream_pb2

ROOM = "hall"
KEY = 32 * "k"


class NatsUser:
    """As an operator makes it: `account` is for nats-server's configuration, `lines` for that of the
    gateway."""

    def __init__(self, folder, name, *more):
        text = subprocess.run([PALPATE_WEB, "nats-user", name, "--room", ROOM, *more], check=True,
                              capture_output=True, text=True).stdout
        comment, _, self.account = text.partition("\n")
        self.name, self.password = name, comment.split()[-1]
        file = folder / f"{name}.password"
        file.write_text(self.password)
        file.chmod(0o600)
        self.lines = f'\n[nats]\nuser = "{name}"\npassword_file = "{file}"\n'


def hub_config(room, port):
    """Lines for a server that leaf servers reach at this port of all addresses. Each is bound to the
    account of the site as whose user it comes."""
    users = "\n".join(f'{{ user: "{site.name}", password: "{site.password}", '
                      f'account: "palpate.{ROOM}.{site.name}" }}' for site in room.sites)
    return (f'leafnodes {{ listen: "0.0.0.0:{port}"\nauthorization {{ users: [\n{users}\n] }} }}')


def leaf_config(address, port, site):
    """Without a domain of its own, nats-server would not let asks of JetStream through."""
    return ('default_js_domain { "$G": "" }\nleafnodes { reconnect: 1, remotes: [ { '
            f'url: "nats-leaf://{site.name}:{site.password}@{address}:{port}" }} ] }}')


class Room:
    """Its parts: `daemon`, `nats`, `publisher`, `receivers`, and `sites`: the receivers' NatsUsers,
    each for one. A `with` block ends all.

    daemon: arguments of Daemon by name. config: lines of all gateways. steers: settings that users
    of the receivers may change. more_sites: for receivers that come later. server: more lines for
    nats-server, after its accounts. wrapper: a command that runs what is beside palpated. is_direct:
    the receivers are at palpated itself, without NATS."""

    def __init__(self, receivers, daemon=None, config="", steers=(), more_sites=1,
                 server=lambda room: "", wrapper=(), is_direct=False):
        self._stack = contextlib.ExitStack()
        self._config = config
        self.daemon = self.nats = self.publisher = None
        self.receivers = []
        try:
            self.folder = pathlib.Path(self._stack.enter_context(
                tempfile.TemporaryDirectory(prefix="palpate-test-")))
            self.daemon = self._stack.enter_context(Daemon(**(daemon or {})))
            if not is_direct:
                self._start_nats(receivers + more_sites, steers, server, wrapper)
            for _ in range(receivers):
                self.receive()
        except BaseException:
            self._stack.close()
            raise

    def _start_nats(self, sites, steers, server, wrapper):
        publisher = NatsUser(self.folder, "publisher", "--publishes")
        self.sites = [NatsUser(self.folder, f"site-{n}") for n in range(sites)]
        accounts = "\n".join(user.account for user in (publisher, *self.sites))
        self.nats = self._stack.enter_context(NatsServer(
            f"{JETSTREAM}\naccounts {{\n{accounts}\n}}\n{server(self)}", wrapper=wrapper))
        may_steer = ", ".join(f'"{key}"' for key in steers)
        lines = "".join(f'[[site]]\nname = "{site.name}"\nmay_steer = [{may_steer}]\n'
                        for site in self.sites if steers)
        self.publisher = self._gateway(self.daemon, ["--publish", self.nats.url, "--room", ROOM],
                                       self._config + publisher.lines + lines, wrapper)

    def _gateway(self, *arguments):
        return self._stack.enter_context(Gateway(*arguments, key=KEY))

    def receive(self, nats=None, wrapper=(), config=""):
        """One more receiving gateway. nats: the server that it is at, without a user, if not the
        room's."""
        if not self.nats:
            daemon, more = self.daemon, []
        else:
            daemon, more = None, ["--from", (nats or self.nats).url, "--room", ROOM]
            config += "" if nats else self.sites[len(self.receivers)].lines
        self.receivers.append(self._gateway(daemon, more, self._config + config, wrapper))
        return self.receivers[-1]

    def processes(self):
        """By their names: pids."""
        found = {"palpated": self.daemon.pid}
        if self.nats:
            found |= {"publisher": self.publisher.process.pid,
                      "nats-server": self.nats.process.pid}
        return found | {f"receiver {n}": gateway.process.pid
                        for n, gateway in enumerate(self.receivers)}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stack.close()


def processor_s(pid):
    """That it took since its start; 0: it is gone."""
    try:
        fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except FileNotFoundError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def machine_s():
    """Processor time that all of the machine's programs took since its start; and what the host
    took."""
    with open("/proc/stat", encoding="ascii") as file:
        ticks = [int(field) for field in file.readline().split()[1:9]]
    hertz = os.sysconf("SC_CLK_TCK")
    return (sum(ticks) - ticks[3] - ticks[4] - ticks[7]) / hertz, ticks[7] / hertz


def resident_bytes(pid):
    pages = int(pathlib.Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGESIZE")


def open_files(pid):
    return len(os.listdir(f"/proc/{pid}/fd"))


class _Revision(StreamReader):
    """To its first complete state."""

    hash = None

    def wait(self):
        self._thread.join(PATIENCE_S)
        self.stop()
        if self.hash is None:
            raise RuntimeError(f"palpated says no content hash: {self.error}")

    def take(self, message):
        if message.WhichOneof("event") != "complete":
            return True
        complete = message.complete
        self.hash = f"{complete.content_hash_high:016x}{complete.content_hash_low:016x}"
        return False


def hash_of_palpated(daemon):
    """The content hash of its volume now, as its own stream of voxels says it."""
    with Client(daemon) as client:
        start = volume_stream_pb2.StreamVolumeRequest()
        start.start.SetInParent()
        reader = _Revision(client.volume.StreamVolume, start)
        reader.wait()
        return reader.hash


def content_hash(voxels):
    """Of an array, as palpated computes it: sums of each half of XXH3-128 of the bricks of 8 x 8 x 8
    floats. Axes that are not multiples of 8 are padded with zeros, the background."""
    counts = [-(-axis // 8) for axis in voxels.shape]
    whole = np.zeros([8 * count for count in counts], "<f4")
    whole[tuple(map(slice, voxels.shape))] = voxels
    bricks = (whole.reshape(counts[0], 8, counts[1], 8, counts[2], 8)
              .transpose(0, 2, 4, 1, 3, 5).reshape(-1, 512))
    high = low = 0
    for number, brick in enumerate(bricks):
        digest = xxhash.xxh3_128_intdigest(brick.tobytes(), number)
        high, low = high + (digest >> 64), low + (digest & (2**64 - 1))
    return f"{high % 2**64:016x}{low % 2**64:016x}"
