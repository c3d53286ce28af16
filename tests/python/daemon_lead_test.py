"""Calls that lead the simulated hand, as bare gRPC: what they may do wrong, and how they end. What
the C++ library does with them: hand_lead_test.cpp."""

import math
import queue
import subprocess
import sys
import unittest

import grpc
import numpy as np

from calls import ABORTED, BAD, CallsTest, vector
from palpate.v1 import device_pb2, registration_pb2, volume_pb2
from support import PATIENCE_S, Client, Daemon, wait_until

LATE = grpc.StatusCode.DEADLINE_EXCEEDED
FREE = (60.0, 40.0, 20.0)  # a place without material

# Leads until it is killed.
ENDLESS = """
import itertools, sys, time
import grpc
from palpate.v1 import device_pb2, device_pb2_grpc, geometry_pb2
def targets():
    for _ in itertools.count():
        yield device_pb2.LeadHandRequest(target_mm=geometry_pb2.Vector3(x=60, y=40, z=20))
        time.sleep(0.02)
channel = grpc.insecure_channel("unix:" + sys.argv[1])
list(device_pb2_grpc.DeviceServiceStub(channel).LeadHand(targets()))
"""


class Lead:
    """Until its end, or that of the test."""

    def __init__(self, test, stubs):
        self._requests = queue.Queue()
        self.call = stubs.device.LeadHand(iter(self._requests.get, None))
        test.addCleanup(self.done)

    def send(self, request):
        self._requests.put(request)

    def to(self, x, y, z, buttons=0):
        self.send(device_pb2.LeadHandRequest(target_mm=vector(x, y, z), buttons=buttons))

    def done(self):
        self._requests.put(None)


class LeadTest(CallsTest):
    volume = "builtin:sphere:48"

    def setUp(self):
        self.assertTrue(wait_until(lambda: self.led_by() == "", PATIENCE_S))

    def led_by(self):
        return self.stubs.device.GetDevice(device_pb2.GetDeviceRequest()).hand_led_by

    def lead(self, place=FREE):
        """A call whose hand follows."""
        lead = Lead(self, self.stubs)
        lead.to(*place)
        self.assertGreater(next(lead.call).applied_tick, 0)
        return lead

    def rests(self, lead, place, target=None):
        """The hand, while its targets go on."""
        with self.conn.poses(200, 1) as stream:
            def is_there():
                lead.to(*(target or place))
                return np.linalg.norm(next(stream).hip_mm[-1] - np.array(place)) < 0.3
            self.assertTrue(wait_until(is_there, PATIENCE_S))

    def test_the_second_hears_who_leads_and_the_first_may_end(self):
        lead = self.lead()
        self.assertEqual(self.led_by(), "local socket")
        second = Lead(self, self.stubs)
        second.to(0, 0, 0)
        self.assertIn("local socket", self.refused(ABORTED, lambda: second.call))
        lead.to(*FREE)
        lead.done()
        self.assertEqual(list(lead.call), [])
        self.assertEqual(lead.call.code(), grpc.StatusCode.OK)
        self.assertEqual(self.led_by(), "")
        self.rests(self.lead(), FREE)

    def test_a_second_of_silence_ends_it(self):
        for speaks in (True, False):
            lead = self.lead() if speaks else Lead(self, self.stubs)
            self.refused(LATE, lambda lead=lead: lead.call)
            self.assertEqual(self.led_by(), "")

    def test_a_target_that_is_none_ends_it(self):
        good = device_pb2.LeadHandRequest(target_mm=vector(*FREE))
        for bad in (device_pb2.LeadHandRequest(), device_pb2.LeadHandRequest(buttons=1),
                    *(device_pb2.LeadHandRequest(target_mm=vector(0, strange, 0))
                      for strange in (math.nan, math.inf, -math.inf))):
            for before in ((), (good,)):
                lead = Lead(self, self.stubs)
                for request in (*before, bad):
                    lead.send(request)
                self.assertIn("target_mm", self.refused(BAD, lambda lead=lead: lead.call))
                self.assertEqual(self.led_by(), "")

    def test_a_cancelled_or_killed_client_gives_it_back(self):
        for _ in range(20):
            self.lead().call.cancel()
            self.assertTrue(wait_until(lambda: self.led_by() == "", PATIENCE_S))
        with subprocess.Popen([sys.executable, "-c", ENDLESS, self.daemon.socket]) as client:
            self.addCleanup(client.kill)
            self.assertTrue(wait_until(lambda: self.led_by() != "", PATIENCE_S))
            client.kill()
        self.assertTrue(wait_until(lambda: self.led_by() == "", PATIENCE_S))

    def test_its_targets_reach_beyond_the_workspace_and_no_farther(self):
        lead = self.lead()
        device = self.stubs.device.GetDevice(device_pb2.GetDeviceRequest()).device
        for far in (1e3, 1e300):
            self.rests(lead, (device.workspace_max_mm.x, device.workspace_max_mm.y,
                              device.workspace_max_mm.z), (far, far, far))

    def test_buttons_that_the_stylus_lacks_are_not_pressed(self):
        lead = self.lead()
        with self.conn.poses(200, 1) as stream:
            for sent, pressed in ((3, 3), (0xffffffff, 3), (4, 0)):
                def is_so(sent=sent, pressed=pressed):
                    lead.to(*FREE, buttons=sent)
                    return next(stream).buttons[-1] == pressed
                self.assertTrue(wait_until(is_so, PATIENCE_S), sent)

    def test_without_forces_it_goes_through_the_surface(self):
        lead = self.lead()
        center = self.stubs.registration.GetRegistration(
            registration_pb2.GetRegistrationRequest()).registration.center_mm
        self.stubs.device.StopForces(device_pb2.StopForcesRequest())
        self.addCleanup(self.stubs.device.EnableForces, device_pb2.EnableForcesRequest())
        self.rests(lead, (center.x, center.y, center.z))

    def test_another_volume_leaves_it_to_its_leader(self):
        lead = self.lead()
        for source in ("builtin:bumps:32", self.volume):
            load = self.stubs.volume.LoadVolume(volume_pb2.LoadVolumeRequest(source=source))
            for _ in load:
                lead.to(*FREE)
            self.rests(lead, FREE)
        self.assertEqual(self.led_by(), "local socket")


class LastLead(unittest.TestCase):
    # A daemon of its own: it leaves out lines about who leads often.
    def test_the_log_says_who_leads(self):
        with Daemon("builtin:sphere:32") as daemon, Client(daemon) as stubs:
            lead = Lead(self, stubs)
            lead.to(*FREE)
            next(lead.call)
            lead.done()
            for part in ("hand: led by local socket", "hand: given back by local socket"):
                self.assertTrue(wait_until(
                    lambda part=part: any(part in line for line in daemon.said)), part)

    def test_a_daemon_ends_in_order_while_it_is_led(self):
        with Daemon("builtin:sphere:32") as daemon, Client(daemon) as stubs:
            lead = Lead(self, stubs)
            lead.to(*FREE)
            next(lead.call)
            self.assertEqual(daemon.end(), 0)
            with self.assertRaises(grpc.RpcError):
                list(lead.call)


if __name__ == "__main__":
    unittest.main()
