"""Two sites far away: palpated, its gateway and a nats-server (the hub) in one network namespace; in
each of two others a nats-server as a leaf of the hub, a receiving palpate-web and its guests. Slow
links (tests/support/slow_link.py) join them: each delays by half of --round-trip-ms one way, and
drops --loss of the packets in each direction.

Says how old the poses are at the sites' guests, and how long a site's first whole copy takes: from
its gateway's start until that shows a volume (over the link), and until a guest at the site has
copied it. The congestion control of TCP is the machine's unless told otherwise."""

import argparse
import contextlib
import json
import pathlib
import subprocess
import sys
import tempfile
import time

from copy_guest import CopyGuest
from nats import NatsServer
from nats_join import texture
from network_sites import Sites
from room import KEY, Room, hash_of_palpated, hub_config, leaf_config
from support import PALPATED, wait_until

WEB_GUESTS = pathlib.Path(PALPATED).parent.parent / "tests" / "web_guests"
LEAF_PORT = 7422


class Site:
    """A leaf server, a gateway that receives from it, and what guests there see."""

    def __init__(self, stack, room, sites, number):
        self.wrapper, self.name = sites.sites[number], f"site {number}"
        self.nats = stack.enter_context(NatsServer(
            leaf_config(sites.hub_address(number), LEAF_PORT, room.sites[number]),
            wrapper=self.wrapper))
        self._room = room

    def begin_to_copy(self, patience_s):
        """Starts the gateway. A guest there waits for the first volume, copies it, and then watches
        poses."""
        guest = CopyGuest(KEY, 20.0, patience_s, self.wrapper)
        began = time.monotonic()
        self.gateway = self._room.receive(self.nats, self.wrapper)
        guest.go(self.gateway.port, began)
        return guest

    def begin_to_watch(self, guests, seconds):
        return subprocess.Popen(
            [*self.wrapper, str(WEB_GUESTS), "127.0.0.1", str(self.gateway.port), KEY, str(guests),
             str(seconds)], stdout=subprocess.PIPE, text=True)


def measure_poses(sites, options, when):
    crowds = [site.begin_to_watch(options.guests, options.seconds) for site in sites]
    for site, crowd in zip(sites, crowds):
        report = json.loads(crowd.communicate()[0])
        ages = [client["age_ms"] for client in report["clients"] if client["age_ms"]]
        if not ages:
            raise RuntimeError(f"{site.name}: no poses")
        print(f"{site.name}, {when}: {len(ages)} guests, age p50 {max(a['p50'] for a in ages):.1f} "
              f"ms, p99 {max(a['p99'] for a in ages):.1f} ms, worst "
              f"{max(a['worst'] for a in ages):.1f} ms, least "
              f"{report['fewest_poses_a_second']:.1f} poses/s", flush=True)


def measure_copy(sites, room, options):
    wanted, found = hash_of_palpated(room.daemon), []
    guests = [site.begin_to_copy(options.patience) for site in sites]
    for site, guest in zip(sites, guests):
        figures = guest.figures()
        print(f"{site.name}: the gateway shows a whole volume of {options.edge}^3 after "
              f"{figures['manifest_s']:.1f} s, a guest there has it after {figures['copy_s']:.1f} "
              f"s ({figures['bytes'] / 1e6:.1f} MB); poses' age while copying "
              f"{figures['age_while_copying_ms']}, after it {figures['age_ms']}", flush=True)
        if figures["copy_hash"] != wanted:
            found.append(f"{site.name}: the copy is not palpated's volume")
    return found


def volume_file(folder, edge):
    file = pathlib.Path(folder) / "texture.nrrd"
    header = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {edge} {edge} {edge}\nencoding: raw\n\n"
    file.write_bytes(header.encode() + texture(edge).tobytes(order="F"))
    return str(file)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--round-trip-ms", type=float, default=80.0, help="half of it each way [80]")
    parser.add_argument("--loss", type=float, default=0.01, help="share, each way [0.01]")
    parser.add_argument("--edge", type=int, default=512, help="of the volume [512]")
    parser.add_argument("--guests", type=int, default=10, help="at each site [10]")
    parser.add_argument("--seconds", type=float, default=30.0, help="of poses [30]")
    parser.add_argument("--patience", type=float, default=900.0, help="seconds for a copy [900]")
    parser.add_argument("--congestion",
                        help="such as reno, if the kernel allows it there [the machine's]")
    options = parser.parse_args()
    with contextlib.ExitStack() as stack:
        network = stack.enter_context(Sites(2, options.round_trip_ms / 2e3, options.loss))
        for wrapper in (network.hub, *network.sites):
            if options.congestion:
                subprocess.run([*wrapper, "sysctl", "-qw",
                                f"net.ipv4.tcp_congestion_control={options.congestion}"], check=True)
        print(subprocess.run([*network.hub, "sysctl", "net.ipv4.tcp_congestion_control"],
                             stdout=subprocess.PIPE, text=True, check=True).stdout.strip())
        # palpated is reached by its socket: it may be anywhere.
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="palpate-test-"))
        room = stack.enter_context(Room(0, {"volume": volume_file(folder, options.edge)}, more_sites=2,
                                        server=lambda room: hub_config(room, LEAF_PORT), wrapper=network.hub))
        # The sites' copies do not wait for the room's.
        wait_until(lambda: any("is published" in line for line in room.publisher.said))
        sites = [Site(stack, room, network, number) for number in range(2)]
        found = measure_copy(sites, room, options)
        measure_poses(sites, options, "at rest")
    for number, link in enumerate(network.links):
        print(f"link {number}: {link.figures}")
    for line in found:
        print(f"FAILED: {line}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
