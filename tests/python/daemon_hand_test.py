"""The simulated hand of a daemon: what operators' calls do to its forces, and what it does with its
buttons. What it finds: hand_contact_test and hand_guide_test."""

import concurrent.futures
import random
import threading
import unittest

import grpc
import numpy as np

import palpate
from calls import CallsTest
from palpate.v1 import device_pb2, volume_pb2
from support import PATIENCE_S, wait_until


class Collected:
    """Every pose from now on, read on a thread of its own."""

    def __init__(self, conn):
        self._poses = []
        self._stream = conn.poses(1000, 16, waiting=1000)
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        if not wait_until(lambda: self._poses, PATIENCE_S):
            raise RuntimeError("no poses come")

    def _read(self):
        for poses in self._stream:
            self._poses.append(poses)

    def all(self):
        # A copy: the thread goes on.
        return palpate.Poses.concatenate(self._poses[:])

    def has(self, tick):
        return self._poses[-1].tick[-1] >= tick

    def end(self):
        self._stream.close()
        self._thread.join()
        return self.all()


def newtons(poses):
    return np.linalg.norm(poses.force_n, axis=1)


def suspended(poses):
    return poses.mode == palpate.ProxyMode.SUSPENDED


class Forces(CallsTest):
    """What an operator's calls do to the forces: counted in ticks, as the samples tell."""

    volume = "builtin:bumps:48"
    felt_n = 0.3

    def setUp(self):
        self.enable()
        self.collected = Collected(self.conn)
        self.addCleanup(self.collected.end)

    def enable(self):
        return self.stubs.device.EnableForces(device_pb2.EnableForcesRequest())

    def disable(self):
        return self.stubs.device.DisableForces(device_pb2.DisableForcesRequest())

    def stop(self):
        return self.stubs.device.StopForces(device_pb2.StopForcesRequest())

    def wait_for_force(self):
        with self.conn.poses(500) as stream:
            self.assertTrue(wait_until(lambda: newtons(next(stream))[-1] > self.felt_n, 120))

    def test_a_stop_is_no_force_in_its_tick(self):
        """Under a force, which was there in the tick before."""
        for _ in range(50):
            self.wait_for_force()
            stopped = self.stop().applied_tick
            self.assertTrue(wait_until(lambda: self.collected.has(stopped + 100), 60))
            enabled = self.enable().applied_tick
            poses = self.collected.all()
            at = (poses.tick >= stopped) & (poses.tick < enabled)
            self.assertGreater(at.sum(), 1)
            self.assertTrue((poses.force_state[at] == palpate.ForceState.STOPPED).all())
            np.testing.assert_array_equal(newtons(poses)[at], 0)
            if (newtons(poses)[poses.tick == stopped - 1] > self.felt_n).any():
                return
        self.fail("the hand felt nothing when it was called")

    def test_no_force_after_the_last_stop_of_many_clients(self):
        self.wait_for_force()

        def one_client(seed):
            chance = random.Random(seed)
            for _ in range(40):
                call = chance.choice((self.enable, self.enable, self.disable, self.stop))
                try:
                    call()
                except grpc.RpcError as error:
                    # An enable may lose against another client's stop.
                    if (call, error.code()) != (self.enable, grpc.StatusCode.FAILED_PRECONDITION):
                        raise
            self.stop()  # whichever comes last is a stop

        with concurrent.futures.ThreadPoolExecutor(8) as pool:
            list(pool.map(one_client, range(8)))
        last = self.ticks()
        self.assertTrue(wait_until(lambda: self.collected.has(last + 500), 120))
        poses = self.collected.all()
        stopped = poses.force_state == palpate.ForceState.STOPPED
        self.assertTrue(stopped[poses.tick >= last].all())
        self.assertTrue((newtons(poses)[stopped] == 0).all())
        for state in (palpate.ForceState.ON, palpate.ForceState.OFF):
            self.assertTrue((poses.force_state == state).any(), state)

    def test_a_stop_does_not_wait_for_a_load(self):
        load = self.stubs.volume.LoadVolume(
            volume_pb2.LoadVolumeRequest(source="builtin:gyroid:320"))
        next(load)  # it is under way
        stopped = self.stop().applied_tick
        *_, last = load
        self.assertLess(stopped, last.result.applied_tick)


class Inside(CallsTest):
    """A surface that comes over the stylus is no fault, and the simulated hand comes out."""

    volume = "builtin:sphere:48"

    def touching(self, stream):
        self.assertTrue(wait_until(lambda: next(stream).contact.any(), 120))

    def no_faults(self):
        return not list((self.daemon.folder / "state" / "faults").glob("*"))

    def test_a_volume_that_is_moved_over_it(self):
        with self.conn.poses(500, 50, waiting=20) as stream:
            self.touching(stream)
            # By itself the hand goes on, and on a busy machine the volume would come too late.
            touched_mm = next(stream).hip_mm[-1]
            seen = []

            def sees(holds):
                seen.append(next(stream))
                return holds(seen[-1]).any()
            with self.conn.device.lead(touched_mm):
                self.assertTrue(wait_until(lambda: sees(lambda poses: np.linalg.norm(
                    poses.hip_mm - touched_mm, axis=1) < 1.0), 60))
                self.conn.volume.place(
                    move_mm=0.6 * (touched_mm - self.conn.volume.place().center_mm))
                self.assertTrue(wait_until(lambda: sees(
                    lambda poses: poses.mode == palpate.ProxyMode.INSIDE), 60))
            self.assertTrue((newtons(next(stream)) < 3.3).all())
            self.touching(stream)
        self.assertFalse(any((poses.mode == palpate.ProxyMode.FAULT).any() for poses in seen))
        self.assertTrue(self.no_faults())

    def test_volumes_one_after_the_other(self):
        with self.conn.poses(500, 10, waiting=1000) as stream:
            for name in ("bumps", "gyroid", "cylinder", "sphere", "gyroid:96", "bumps:64"):
                revision = self.conn.volume.load(f"builtin:{name}").volume_revision

                def is_felt(revision=revision):
                    poses = next(stream)
                    self.assertFalse((poses.mode == palpate.ProxyMode.FAULT).any())
                    return (poses.contact & (poses.volume_revision == revision)).any()
                self.assertTrue(wait_until(is_felt, 120), name)
        self.assertTrue(self.no_faults())


class Tools(CallsTest):
    """The simulated hand holds both buttons now and then."""

    volume = "builtin:bumps:32"
    config = "[device]\npressed_buttons = 3\n[haptics]\ncarve_tool = true\ncarve_radius_mm = 6.0\n"

    def test_the_stylus_carves_and_moves_the_volume(self):
        before = self.conn.volume.info()
        self.assertTrue(wait_until(lambda: self.conn.volume.info().volume_revision
                                   > before.volume_revision + 5, 120))
        self.assertEqual(self.conn.volume.place().center_mm[0], 0)
        self.conn.settings.update(carve_tool=False, clutch_tool=True)
        collected = Collected(self.conn)
        self.addCleanup(collected.end)
        self.assertTrue(wait_until(lambda: self.conn.volume.place().center_mm[0] != 0
                                   and suspended(collected.all()).sum() > 100, 120))
        poses = collected.end()
        self.assertTrue((newtons(poses)[suspended(poses)] == 0).all())
        self.assertTrue((poses.buttons[suspended(poses)] & 2 != 0).all())


if __name__ == "__main__":
    unittest.main()
