"""The metrics: what is scraped from a working palpated and palpate-web, its documentation, and the
dashboard.
Addresses that are refused: config_check_test and daemon_service_test."""

import json
import pathlib
import re
import socket
import subprocess
import threading
import unittest

from free_port import free_port
from gateway import Gateway
from palpate.v1 import device_pb2, pose_pb2, recording_pb2
from support import (CALL_S, Client, Daemon, PoseReader, metric, parse_metrics, scrape,
                     wait_until)

ROOT = pathlib.Path(__file__).resolve().parents[2]
GUIDE = ROOT / "deploy/guides/metrics.md"
DASHBOARD = ROOT / "deploy/grafana/palpate.json"


def documented(gateway=False):
    """{name: type} of the guide's tables: of palpated, or those of palpate-web's own."""
    rows = re.findall(r"^\| `([a-z_]+)` \| (\w+) \|", GUIDE.read_text(), re.MULTILINE)
    return {name: kind for name, kind in rows if name.startswith("palpate_web_") == gateway}


def base_name(name, families):
    if name in families:
        return name
    return re.sub(r"_(bucket|sum|count)$", "", name)


def queried():
    """Every query of the dashboard."""
    def walk(node):
        if isinstance(node, dict):
            if isinstance(node.get("expr"), str):
                yield node["expr"]
            node = list(node.values())
        if isinstance(node, list):
            for child in node:
                yield from walk(child)
    return list(walk(json.loads(DASHBOARD.read_text())))


class LiveMetrics(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = cls.enterClassContext(Daemon(metrics=True))
        cls.client = cls.enterClassContext(Client(cls.daemon))

    def scrape(self):
        return parse_metrics(scrape(self.daemon.metrics_port))

    def value(self, key):
        return metric(self.daemon.metrics_port, key)

    def test_each_is_documented_and_each_documented_one_is_there(self):
        scrape(self.daemon.metrics_port)  # the exposer's own begin with the first
        families, values = self.scrape()
        self.assertEqual({name: kind for name, (kind, _) in families.items()}, documented())
        for name, (kind, _) in families.items():
            with self.subTest(name):
                self.assertEqual(name.endswith("_total"), kind == "counter")
                self.assertRegex(name, "^(palpate|exposer)_")
                self.assertNotRegex(name, "_(ms|us|ns|mm|mib|kib|percent)(_|$)")
        self.assertTrue(values)

    def test_the_dashboard_asks_for_what_there_is(self):
        scrape(self.daemon.metrics_port)
        families, _ = self.scrape()
        queries = queried()
        self.assertGreater(len(queries), 12)
        asked = {base_name(name, families)
                 for query in queries for name in re.findall(r"\b(?:palpate|exposer)_\w+", query)}
        self.assertEqual(asked - set(families), set())
        # Whoever adds a metric of the loop shows it.
        shown = {name for name in families if name.startswith("palpate_")}
        self.assertLess(len(shown - asked), 8, shown - asked)

    def test_forces_show(self):
        def forces(state):
            return self.value(f'palpate_forces{{state="{state}"}}') == 1

        self.assertTrue(wait_until(lambda: self.value("palpate_contact_ticks_total") > 0))
        self.assertTrue(wait_until(lambda: forces("on")))
        _, values = self.scrape()
        self.assertEqual(values["palpate_contact_faults_total"], 0)
        self.assertEqual(values["palpate_faulty_ticks_total"], 0)
        for name in ("palpate_force_limit_newtons", "palpate_tick_period_seconds_count",
                     "palpate_update_seconds_count", "palpate_force_newtons_count"):
            self.assertGreater(values[name], 0, name)
        self.assertEqual(sum(value for key, value in values.items()
                             if key.startswith("palpate_forces{")), 1)
        self.client.device.StopForces(device_pb2.StopForcesRequest(), timeout=CALL_S)
        self.assertTrue(wait_until(lambda: forces("stopped")))
        self.client.device.EnableForces(device_pb2.EnableForcesRequest(device="simulated"),
                                        timeout=CALL_S)
        self.assertTrue(wait_until(lambda: forces("on")))

    def test_subscribers_and_the_age_of_what_they_see(self):
        self.assertTrue(wait_until(lambda: self.value("palpate_pose_streams") == 0))
        reader = PoseReader(self.client, rate_hz=500.0, batch=5)
        self.assertTrue(wait_until(lambda: reader.samples > 100))
        _, values = self.scrape()
        self.assertEqual(values["palpate_pose_streams"], 1)
        self.assertGreaterEqual(values["palpate_pose_age_sent_seconds_count"], 20)
        acknowledged = "palpate_pose_age_acknowledged_seconds"
        self.assertTrue(wait_until(lambda: self.value(f"{acknowledged}_count") >= 10))
        # An acknowledgement is younger than the pose that it is for by no clock.
        self.assertGreater(self.value(f"{acknowledged}_sum"), 0)
        reader.stop()
        self.assertTrue(wait_until(lambda: self.value("palpate_pose_streams") == 0))

    def test_drops_of_one_who_does_not_acknowledge(self):
        before = self.value("palpate_dropped_samples_total")
        first = pose_pb2.StreamPosesRequest()
        first.start.rate_hz = 1000
        first.start.batch = 10
        first.start.max_unacknowledged = 1
        acknowledges, ends = threading.Event(), threading.Event()

        def requests():
            yield first
            acknowledges.wait()
            late = pose_pb2.StreamPosesRequest()
            late.acknowledgement.message_number = 1
            yield late
            ends.wait()

        self.addCleanup(ends.set)
        self.addCleanup(acknowledges.set)
        call = self.client.poses.StreamPoses(requests())
        next(call)
        tick = self.client.servo().ticks
        self.assertTrue(wait_until(lambda: self.client.servo().ticks > tick + 300))
        acknowledges.set()
        message = next(call)  # it says how many it lost
        self.assertGreater(message.dropped_samples, 200)
        self.assertEqual(self.value("palpate_dropped_samples_total") - before,
                         message.dropped_samples)
        call.cancel()

    def test_changes_show_their_revision_and_latency(self):
        _, before = self.scrape()
        for n in range(5):
            applied = self.client.set_stiffness(0.4 + 0.01 * n)
            edited = self.client.carve(24, 24, 8 + n)
        self.assertTrue(wait_until(
            lambda: self.value("palpate_settings_revision") == applied.settings_revision))
        _, values = self.scrape()
        self.assertEqual(values["palpate_volume_revision"], edited.volume_revision)
        for name in ("palpate_edit_latency_seconds", "palpate_settings_latency_seconds"):
            self.assertEqual(values[name + "_count"] - before[name + "_count"], 5)
            self.assertGreater(values[name + "_sum"], before[name + "_sum"])

    def test_a_recording_shows(self):
        self.assertEqual(self.value("palpate_recording"), 0)
        self.client.record(self.daemon.folder / "shown.mcap")
        self.assertEqual(self.value("palpate_recording"), 1)
        self.client.recording.StopRecording(recording_pb2.StopRecordingRequest(), timeout=CALL_S)
        self.assertEqual(self.value("palpate_recording"), 0)

    def test_memory_and_files_are_those_of_the_process(self):
        def agrees():
            # Both move while connections of others end.
            _, values = self.scrape()
            resident = self.daemon.resident_bytes()
            return (abs(values["palpate_resident_memory_bytes"] - resident) < 0.2 * resident
                    and abs(values["palpate_open_files"] - self.daemon.open_files()) <= 4)
        self.assertTrue(wait_until(agrees))
        _, values = self.scrape()
        self.assertGreaterEqual(values["palpate_volume_memory_bytes"], 48 ** 3)
        self.assertLess(values["palpate_volume_memory_bytes"],
                        values["palpate_volume_memory_budget_bytes"])

    def test_none_unless_asked_for(self):
        with Daemon() as daemon:
            listening = subprocess.run(["ss", "-Hltnp"], capture_output=True, text=True).stdout
            self.assertNotIn(f"pid={daemon.pid},", listening)

    def test_only_the_metrics_are_served(self):
        for path in ("/", "/../etc/passwd", "/metrics/../../etc/passwd", "//etc/passwd"):
            with socket.create_connection(("127.0.0.1", self.daemon.metrics_port)) as raw:
                raw.sendall(f"GET {path} HTTP/1.0\r\n\r\n".encode())
                raw.settimeout(CALL_S)
                answer = raw.recv(4096)
            self.assertNotIn(b"root:", answer, path)
            self.assertRegex(answer, rb"^HTTP/1\.\d 4", path)

    def test_readers_that_hang_do_not_hold_the_others(self):
        hanging = [socket.create_connection(("127.0.0.1", self.daemon.metrics_port))
                   for _ in range(8)]
        for connection in hanging:
            connection.sendall(b"GET /metrics HT")
        self.assertIn("palpate_ticks_total", scrape(self.daemon.metrics_port))
        for connection in hanging:
            connection.close()


class GatewayMetrics(unittest.TestCase):
    def families(self, *more):
        port = free_port()
        with Daemon() as daemon, Gateway(daemon, ("--metrics", f"127.0.0.1:{port}", *more)) as gateway:
            gateway.ask("GET", "/health")
            return parse_metrics(scrape(port))[0]

    def test_each_is_documented(self):
        families = self.families()
        self.assertNotIn("palpate_web_nats_connected", families)
        families |= self.families("--publish", f"nats://127.0.0.1:{free_port()}", "--room", "hall")
        self.assertIn("palpate_web_nats_connected", families)
        shown = {name: kind for name, (kind, _) in families.items()
                 if not name.startswith("exposer_")}
        # Counters with a label come with their first event.
        self.assertIn("palpate_web_answers_total", shown)
        self.assertLessEqual(shown.items(), documented(gateway=True).items())


if __name__ == "__main__":
    unittest.main()
