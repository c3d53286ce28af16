"""The simulated hand of a daemon: what operators' calls do to its forces, what it finds, and what it
does with its buttons."""

import concurrent.futures
import random
import tempfile
import threading
import unittest

import grpc
import numpy as np

import palpate
from calls import UNTURNED, CallsTest
from palpate.v1 import device_pb2, volume_pb2
from support import PATIENCE_S, Daemon, nrrd, wait_until


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


class Forces(CallsTest):
    """What an operator's calls do to the forces: counted in ticks, as the samples tell."""

    volume = "builtin:bumps:48"
    felt_n = 0.3
    slew_n_per_tick = 0.2
    ramp_out_ticks = 17  # 3.3 N

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

    def poses_of(self, call, state):
        """Calls it under a force. Returns the samples from the tick before the one that it names,
        until the forces are enabled again."""
        for _ in range(50):
            self.wait_for_force()
            answer = call()
            self.assertEqual(answer.forces.state, state)
            self.assertTrue(wait_until(lambda: self.collected.has(answer.applied_tick + 100), 60))
            enabled = self.enable().applied_tick
            poses = self.collected.all()
            at = (poses.tick >= answer.applied_tick - 1) & (poses.tick < enabled)
            tick, force_n = poses.tick[at], newtons(poses)[at]
            self.assertTrue((poses.force_state[at][tick >= answer.applied_tick] == state).all())
            if tick[0] == answer.applied_tick - 1 and force_n[0] > self.felt_n:
                return tick.astype(int) - answer.applied_tick, force_n
        self.fail("the hand felt nothing when it was called")

    def test_a_stop_is_no_force_in_its_tick(self):
        tick, force_n = self.poses_of(self.stop, device_pb2.FORCE_STATE_STOPPED)
        self.assertGreater(len(tick), 1)
        np.testing.assert_array_equal(force_n[tick >= 0], 0)

    def test_disabled_forces_go_by_the_slew_limit(self):
        tick, force_n = self.poses_of(self.disable, device_pb2.FORCE_STATE_OFF)
        np.testing.assert_array_equal(force_n[tick >= self.ramp_out_ticks], 0)
        fall_n = -np.diff(force_n)[np.diff(tick) == 1]
        self.assertTrue(((fall_n >= -1e-12) & (fall_n <= self.slew_n_per_tick + 1e-9)).all())
        self.assertGreater(force_n[1], 0)

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


class Hand(unittest.TestCase):
    def touched(self, conn):
        """Whether the hand touches in 6 of 10 ticks, of 4000 from its first contact on. Ticks that
        are missed may lead it astray: it has three goes."""
        for _ in range(3):
            contact = np.zeros(0, bool)
            with conn.poses(1000, 16, waiting=1000) as stream:
                while len(contact) < 4000:
                    contact = np.append(contact, next(stream).contact)
                    contact = contact[np.argmax(contact):] if contact.any() else contact[:0]
            print(f"{contact.mean():.2f} of the ticks in contact")
            if contact.mean() >= 0.6:
                return True
        return False

    def test_it_finds_what_is_thin(self):
        # A tube of two voxels, which a hand that searches by touch alone meets once in minutes.
        i, j, k = np.indices((96, 96, 96))
        x, y = 48 + 30 * np.sin(0.07 * k), 48 + 30 * np.cos(0.045 * k)
        values = np.clip(1.5 - 0.6 * np.hypot(i - x, j - y), 0, 1).astype(np.float32)
        with tempfile.NamedTemporaryFile(suffix=".nrrd") as file:
            file.write(nrrd(values, UNTURNED, (0.0, 0.0, 0.0)))
            file.flush()
            with Daemon(file.name, more=["--isovalue", "0.5"]) as daemon, \
                    daemon.connect() as conn:
                self.assertTrue(self.touched(conn))
                # It is somewhere else, many times its width from where it was: another plan.
                conn.volume.place(move_mm=(15, 0, 0))
                self.assertTrue(self.touched(conn))


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
                                   and self.suspended(collected).sum() > 100, 120))
        # A move that was under way may still come.
        last = self.conn.settings.update(clutch_tool=False).applied_tick + 200
        self.assertTrue(wait_until(lambda: collected.has(last), 60))
        moved = self.conn.volume.place()
        poses = collected.end()
        suspended = self.suspended(collected)
        self.assertTrue((newtons(poses)[suspended] == 0).all())
        self.assertTrue((poses.buttons[suspended] & 2 != 0).all())
        # Kept, as if a client had moved it; and it stays without the tool.
        self.daemon.end()
        self.daemon.start()
        self.assertTrue(wait_until(self.is_connected, 60))
        np.testing.assert_array_equal(self.conn.volume.place().center_mm, moved.center_mm)

    def is_connected(self):
        try:
            return self.ticks() > 0
        except grpc.RpcError:
            return False

    @staticmethod
    def suspended(collected):
        return collected.all().mode == palpate.ProxyMode.SUSPENDED


if __name__ == "__main__":
    unittest.main()
