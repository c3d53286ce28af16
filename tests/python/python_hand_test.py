"""The simulated hand, led from Python: along a path and live."""

import signal
import threading
import time
import unittest
from unittest import mock

import numpy as np

import palpate
from palpate.v1 import device_pb2_grpc
from secured import SecuredDaemon
from support import PATIENCE_S, Daemon, DaemonTest, wait_until

# Of the simulated hand and its device (devices.md).
SPRING_N_PER_MM = 0.3
RESOLUTION_MM = 0.055


def rest(poses):
    """The newest samples, when the hand has come to rest."""
    return poses.hip_mm[-50:].mean(axis=0), poses.force_n[-50:].mean(axis=0)


class HandTest(DaemonTest):
    def setUp(self):
        place = self.conn.volume.info().device_from_index
        size = np.array(self.conn.volume.info().shape)
        self.center_mm = (place @ np.append((size - 1) / 2, 1.0))[:3]

    def path(self, *points_mm, seconds=1.0):
        """Straight from point to point, and half a second of rest at the last."""
        share = np.linspace(0.0, len(points_mm) - 1.0, int(100 * seconds * (len(points_mm) - 1)))
        corners = np.array(points_mm, dtype=float)
        way = np.stack([np.interp(share, range(len(corners)), column) for column in corners.T], 1)
        return np.vstack([way, np.repeat(way[-1:], 50, axis=0)])

    def above(self, height_mm):
        return self.center_mm + [0.0, height_mm, 0.0]

    def test_in_free_space_the_hand_is_where_the_path_is(self):
        path_mm = self.path(self.above(55), self.above(55) + [30, 0, 0])
        with self.conn.device.lead() as hand:
            felt = hand.follow(path_mm)
        self.assertFalse(felt.contact.any())
        np.testing.assert_allclose(rest(felt)[0], path_mm[-1], atol=2 * RESOLUTION_MM)
        # 30 mm in a second: the hand is never farther behind than 50 ms.
        start = felt.hip_mm[0]
        np.testing.assert_allclose(start, path_mm[0], atol=3 * RESOLUTION_MM)
        way_mm = np.linalg.norm(np.diff(felt.hip_mm[::100], axis=0), axis=1)
        self.assertLess((way_mm / np.diff(felt.time_ns[::100]) * 1e9).max(), 60.0)
        # A sample that is not there is counted.
        self.assertLessEqual(felt.tick[-1] - felt.tick[0] + 1 - len(felt), felt.dropped_samples)
        self.assertTrue((felt.tick[1:] > felt.tick[:-1]).all())

    def test_a_layer_lets_the_hand_pass_and_the_recording_tells_it(self):
        settings = self.conn.settings
        settings.layers = [palpate.Layer("skin", 0.4, 0.3, pop_force_n=0.5),
                           palpate.Layer("core", 0.6, 1.0)]
        self.addCleanup(setattr, settings, "layers", [])
        path = f"{self.daemon.folder}/layers.mcap"
        forces_n = {}  # by direction
        # Where ticks were missed, the hand went on: the force grew past the pop's in no tick.
        for _ in range(20):
            with self.conn.device.lead() as hand:
                self.conn.recording.start(path, overwrite=True)
                hand.follow(self.path(self.above(55), self.center_mm, self.above(55)))
                self.conn.recording.stop()
            recording = palpate.open_recording(path)
            ticks = recording.ticks
            passings = recording.passings()[-2:]  # the hand may have been inside before
            self.assertEqual([(passing.layer, passing.inwards) for passing in passings],
                             [("skin", True), ("skin", False)])
            behind = ticks.layers_passed == 1
            self.assertTrue((ticks.contact_layer[behind] == 2).any())
            self.assertTrue((ticks.density[behind] >= 0.4 - 1e-6).all())
            self.assertTrue((ticks.density[~behind] <= 0.4 + 1e-6).all())
            for passing in passings:
                at = np.searchsorted(ticks.tick, passing.tick)
                if ticks.missed_ticks[at] == ticks.missed_ticks[at - 1]:
                    forces_n[passing.inwards] = passing.force_n
            if len(forces_n) == 2:
                break
        self.assertEqual(set(forces_n), {True, False})
        for force_n in forces_n.values():
            self.assertAlmostEqual(force_n, 0.5, delta=0.05)

    def test_the_surface_holds_the_hand_up_with_a_force(self):
        with self.conn.device.lead() as hand:
            felt = hand.follow(self.path(self.above(55), self.center_mm))
            self.assertIn("socket", self.conn.device.info().hand_led_by)
        hip_mm, force_n = rest(felt)
        self.assertTrue(felt.contact[-1])
        self.assertGreater(force_n[1], 0.5)
        np.testing.assert_allclose(self.center_mm + force_n / SPRING_N_PER_MM, hip_mm, atol=0.2)
        # The proxy never enters the sphere.
        self.assertLessEqual((felt.density - felt.isovalue).max(), 1e-6)
        self.assertGreater(np.linalg.norm(felt.scp_h_mm[-1] - self.center_mm), 5.0)

    def test_the_stylus_is_turned_as_it_is_led(self):
        turned = np.array([np.cos(0.4), 0.0, np.sin(0.4), 0.0])
        with self.conn.device.lead() as hand:
            felt = hand.follow([self.above(55)] * 60, orientations=[turned] * 60)
            for wrong in ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (np.nan, 0.0, 0.0, 0.0)):
                with self.assertRaises(palpate.InvalidArgument):
                    hand.move_to(self.above(55), orientation=wrong)
        self.assertGreater(abs(felt.stylus_orientation[-1] @ turned), np.cos(0.02))

    def test_a_path_is_felt_from_its_begin_to_its_end(self):
        # Also by a program that was held up, and whose stream waits.
        way = np.linspace(0.0, 1.0, 100)[:, None]
        path_mm = self.above(55) + way * [30, 0, 0]

        def held_up(*_):
            time.sleep(1.0)

        with self.conn.device.lead(path_mm[0]) as hand:
            hand.follow(path_mm[:1])
            with mock.patch("palpate._hand._wait_for_rest", held_up):
                felt = hand.follow(path_mm)
        np.testing.assert_allclose(felt.hip_mm[0], path_mm[0], atol=3 * RESOLUTION_MM)
        np.testing.assert_allclose(felt.hip_mm[-1], path_mm[-1], atol=3 * RESOLUTION_MM)

    def test_a_path_begins_at_its_first_point_and_not_where_the_hand_was(self):
        # A target that comes late: the hand still rests at the place before.
        places_mm = [self.above(55), self.above(55) + [20, 0, 0]]
        with self.conn.device.lead(places_mm[0]) as hand:
            hand.follow(places_mm[:1])
            move_to = hand.move_to

            def late(*arguments):
                threading.Timer(0.5, move_to, arguments).start()

            with mock.patch.object(hand, "move_to", late):
                felt = hand.follow(places_mm[1:])
        np.testing.assert_allclose(felt.hip_mm[0], places_mm[1], atol=3 * RESOLUTION_MM)

    def test_a_hand_in_contact_stays_where_it_is(self):
        def moved_mm():
            with self.conn.device.lead() as hand:
                felt = hand.follow(self.path(self.above(55), self.center_mm))
                before_mm, force_n = rest(felt)
            self.assertGreater(np.linalg.norm(force_n), 1.0)
            with self.conn.device.lead(), self.conn.poses(rate_hz=1000, batch=100) as poses:
                for _ in range(5):
                    felt = next(poses)
            return np.linalg.norm(rest(felt)[0] - before_mm)

        # Between the two the hand explores by itself: 1.4 mm in 20 ms, on a slow machine farther.
        self.assertTrue(any(moved_mm() < 1.5 for _ in range(5)))

    def test_a_live_target_replaces_the_one_before(self):
        with self.conn.device.lead(self.above(55)) as hand, \
                self.conn.poses(rate_hz=100) as poses:
            for target_mm in (self.above(50), self.above(50) + [25, 0, 0]):
                hand.move_to(target_mm, buttons=1)
                self.assertTrue(wait_until(lambda at=target_mm: np.linalg.norm(
                    next(poses).hip_mm[0] - at) < 3 * RESOLUTION_MM, PATIENCE_S))
            self.assertEqual(next(poses).buttons[0] & 1, 1)

    def test_what_the_hand_cannot_reach_or_feel_is_said(self):
        least_mm = self.conn.device.info().workspace_min_mm
        beyond_mm = least_mm - [5, 0, 0]
        with self.assertWarnsRegex(UserWarning, "5 mm"), \
                self.conn.device.lead(beyond_mm) as hand:
            felt = hand.follow([beyond_mm])
            np.testing.assert_allclose(felt.hip_mm[-1], least_mm, atol=3 * RESOLUTION_MM)
        self.addCleanup(self.conn.device.enable)
        self.conn.device.disable()
        with self.assertWarnsRegex(UserWarning, "0 N"):
            self.conn.device.lead().close()

    def test_one_program_at_a_time_leads_the_hand(self):
        first = self.conn.device.lead()
        with self.daemon.connect() as other:
            # As a cell of a notebook that runs again.
            with self.assertRaisesRegex(palpate.Conflict, "this program"):
                other.device.lead()
            first.close()
            first.close()
            with self.assertRaises(palpate.InvalidArgument):
                first.move_to((0, 0, 0))
            with other.device.lead() as hand:
                hand.move_to((0, 50, 0))
        self.assertTrue(wait_until(lambda: self.conn.device.info().hand_led_by == ""))

    def test_what_is_no_path_is_refused_at_the_call(self):
        with self.conn.device.lead() as hand:
            for path in ([], [1, 2, 3], [[1, 2]], [[1, 2, np.nan]], "path"):
                with self.assertRaises(palpate.InvalidArgument):
                    hand.follow(path)
            for rate_hz in (0, -1, np.nan, np.inf, "fast"):
                with self.assertRaises(palpate.InvalidArgument):
                    hand.follow([[0, 0, 0]], rate_hz)
            for target_mm in ((1, 2), (1, 2, np.inf)):
                with self.assertRaises(palpate.InvalidArgument):
                    hand.move_to(target_mm)
            with self.assertRaises(palpate.InvalidArgument):
                hand.move_to((0, 0, 0), buttons=-1)
            hand.move_to((0, 55, 0))

    def test_a_daemon_that_goes_away_ends_the_lead(self):
        with Daemon(self.volume) as daemon, daemon.connect() as conn:
            hand = conn.device.lead()
            daemon.end(signal.SIGKILL)
            with self.assertRaises(palpate.Unavailable):
                wait_until(lambda: hand.move_to((0, 0, 0)), PATIENCE_S)
            hand.close()

    def test_a_daemon_that_stands_still_does_not_hold_up_its_client(self):
        with Daemon(self.volume) as daemon, daemon.connect() as conn:
            hand = conn.device.lead()
            daemon.stand_still()
            try:
                closing = threading.Thread(target=hand.close, daemon=True)
                closing.start()
                closing.join(PATIENCE_S)
                self.assertFalse(closing.is_alive())
            finally:
                daemon.process.send_signal(signal.SIGCONT)

    def test_a_daemon_that_stands_still_takes_no_hand(self):
        with Daemon(self.volume) as daemon, daemon.connect() as conn, \
                mock.patch("palpate._hand._TAKE_TIMEOUT_S", 0.5):
            daemon.stand_still()
            try:
                with self.assertRaises(palpate.Unavailable):
                    conn.device.lead((0, 0, 0))
            finally:
                daemon.process.send_signal(signal.SIGCONT)

    def test_a_hand_that_the_daemon_took_back_says_so(self):
        with self.conn.device.lead() as hand:
            request = hand._targets.request

            def late():
                time.sleep(2.0)
                return request()

            hand._targets.request = late
            with self.assertRaisesRegex(palpate.Unavailable, "took the hand back"):
                wait_until(lambda: hand.move_to((0, 0, 0)), PATIENCE_S)

    def test_a_call_that_ends_without_an_answer_leads_no_hand(self):
        name = "palpate.v1.device_pb2_grpc.DeviceServiceStub"
        stub = device_pb2_grpc.DeviceServiceStub

        def without_answer(channel):
            made = stub(channel)
            made.LeadHand = lambda requests: iter(())
            return made

        with mock.patch(name, without_answer), self.assertRaises(palpate.Unavailable):
            self.conn.device.lead((0, 0, 0))

    def test_a_revoked_token_gives_the_hand_back(self):
        with SecuredDaemon() as daemon, daemon.connect() as local, \
                palpate.connect(daemon.address, tls_ca=str(daemon.authority.ca),
                                token_file=str(daemon.tokens["operator"])) as conn:
            hand = conn.device.lead()
            self.assertIn("operator", local.device.info().hand_led_by)
            daemon.revoke_token("operator")
            self.assertTrue(wait_until(lambda: local.device.info().hand_led_by == "", PATIENCE_S))
            with self.assertRaises(palpate.PermissionDenied):
                wait_until(lambda: hand.move_to((0, 0, 0)), PATIENCE_S)
            hand.close()


if __name__ == "__main__":
    unittest.main()
