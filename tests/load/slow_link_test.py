"""The slow link is as slow as it says: what nats_sites.py measures rests on it. Judges times."""

import statistics
import subprocess
import sys
import unittest

from network_sites import Sites

DELAY_S, LOSS = 0.04, 0.01
# Answers datagrams; and takes a stream, whose end it answers with its bytes.
ECHO = """
import socket, sys
datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
datagrams.bind(("0.0.0.0", 9000))
print("ready", flush=True)
while True:
    data, peer = datagrams.recvfrom(2048)
    datagrams.sendto(data, peer)
"""
# Sends a datagram each 2 ms, with its number; prints the times of those that came back.
PING = """
import socket, sys, time
host, count = sys.argv[1], int(sys.argv[2])
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.connect((host, 9000))
link.settimeout(0.002)
sent, came = [], {}
def hear():
    try:
        number = int(link.recv(2048))
        came[number] = time.monotonic() - sent[number]
    except TimeoutError:
        pass
for number in range(count):
    sent.append(time.monotonic())
    link.send(b"%d" % number)
    hear()
end = time.monotonic() + 1
while time.monotonic() < end:
    hear()
print(*came.values())
"""
SINK = """
import socket, time
listening = socket.create_server(("0.0.0.0", 9001))
print("ready", flush=True)
link, _ = listening.accept()
total, begin = 0, time.monotonic()
while data := link.recv(1 << 20):
    total += len(data)
print(total, time.monotonic() - begin, flush=True)
"""
SEND = """
import socket, sys
link = socket.create_connection((sys.argv[1], 9001))
link.sendall(bytes(int(sys.argv[2])))
"""


class SlowLinkTest(unittest.TestCase):
    def in_site(self, sites, code):
        process = subprocess.Popen([*sites.sites[0], sys.executable, "-c", code],
                                   stdout=subprocess.PIPE, text=True)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        self.assertEqual(process.stdout.readline(), "ready\n")
        return process

    def test_delay_and_loss_are_what_was_asked_for(self):
        count = 5000
        with Sites(1, DELAY_S, LOSS) as sites:
            self.in_site(sites, ECHO)
            said = subprocess.run(
                [*sites.hub, sys.executable, "-c", PING, sites.site_address(0), str(count)],
                check=True, capture_output=True, text=True).stdout
        times = sorted(map(float, said.split()))
        print(f"round trip {1e3 * statistics.median(times):.2f} ms, p99 "
              f"{1e3 * times[int(0.99 * len(times))]:.2f}, lost {count - len(times)} of {count}",
              sites.links[0].figures, flush=True)
        self.assertGreaterEqual(times[0], 2 * DELAY_S)
        self.assertLess(statistics.median(times), 2 * DELAY_S + 0.005)
        # Each packet passes twice: 5 sigma around the mean of a binomial distribution.
        lost = count * (1 - (1 - LOSS) ** 2)
        self.assertLess(abs(count - len(times) - lost), 5 * lost ** 0.5)

    def test_it_carries_more_than_what_is_measured_over_it(self):
        size = 32 << 20
        with Sites(1, 0.0, 0.0) as sites:
            sink = self.in_site(sites, SINK)
            subprocess.run([*sites.hub, sys.executable, "-c", SEND, sites.site_address(0),
                            str(size)], check=True)
            total, seconds = sink.stdout.readline().split()
        print(f"{float(total) / float(seconds) / 1e6:.0f} MB/s", flush=True)
        self.assertEqual(int(total), size)
        self.assertGreater(size / float(seconds), 20e6)


if __name__ == "__main__":
    unittest.main()
