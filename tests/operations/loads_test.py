"""Fifty volumes, loaded in random order while the simulated hand explores: each is felt soon after
it has come, and nothing on the way is a fault."""

import os
import pathlib
import random
import time
import unittest

import numpy as np

import palpate
from stolen import stolen_share
from support import Daemon

DATA = pathlib.Path(os.environ["PALPATE_DATA_DIR"])
# Of the data folder's README: normalised over the range, or in data units.
VOLUMES = [("paper/daisy_192x180x168_uint8.nhdr", 0.24), ("paper/orange_256x256x64_uint8.nhdr", 0.22),
           ("paper/lobster_301x324x56_uint8.nhdr", 0.16),
           ("paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.33),
           ("paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.17),
           ("paper/SUBST_neuron_janelia_511x512x47_uint8.nrrd", 0.20),
           ("classic/aneurism_256x256x256_uint8.nrrd", 0.25),
           ("classic/boston_teapot_256x256x178_uint8.nrrd", 0.16),
           ("classic/hydrogen_atom_128x128x128_uint8.nhdr", 0.06),
           ("classic/hydrogen_64x64x64_float32.nrrd", 0.06),
           ("classic/neghip_64x64x64_uint8.nhdr", 0.35), ("classic/fuel_64x64x64_uint8.nhdr", 0.20),
           ("classic/bucky_32x32x32_uint8.nhdr", 0.50), ("classic/tooth_103x94x161_uint8.nhdr", 0.42),
           ("classic/vase_115x101x75_uint8.nrrd", 0.40),
           ("classic/walnut_128x96x114_uint16.nrrd", 0.18),
           ("medical/avg152T1_RL_nifti.nii.gz", 0.38), ("medical/CT_pitch.nii.gz", 0.30),
           ("medical/inia19-t1-brain.nii.gz", 0.12), ("medical/HeadMRVolume.mhd", 0.16),
           ("medical/LIDC2.mha", 0.25), ("medical/dicom_mr_brain_20", 0.22)]
LOADS = 50
SOON_TICKS, LATE_TICKS = 2000, 5000
MOST_LATE = 5


@unittest.skipUnless(all((DATA / name).exists() for name, _ in VOLUMES),
                     "the volumes of the data folder are missing")
class Loads(unittest.TestCase):
    def setUp(self):
        self.enterContext(stolen_share())
        self.daemon = self.enterContext(Daemon())
        self.conn = self.enterContext(self.daemon.connect())

    def ticks_to_contact(self, poses, revision):
        """From the first tick with the volume of this revision on."""
        first = None
        for batch in poses:
            self.assertFalse(np.any(batch.mode == palpate.ProxyMode.FAULT))
            felt = batch.volume_revision == revision
            if not felt.any():
                continue
            first = int(batch.tick[felt][0]) if first is None else first
            touching = felt & batch.contact
            if touching.any():
                return int(batch.tick[touching][0]) - first
            if batch.tick[-1] > first + 2 * LATE_TICKS:
                return 2 * LATE_TICKS
        raise AssertionError("the stream has ended")

    def test_each_is_felt_soon_and_none_is_a_fault(self):
        choice = random.Random(1)
        waits = []
        with self.conn.poses(rate_hz=1000, batch=50, waiting=200) as poses:
            for _ in range(LOADS):
                name, share = choice.choice(VOLUMES)
                loaded = self.conn.volume.load(DATA / name, normalized_isovalue=share)
                waits.append((self.ticks_to_contact(poses, loaded.volume_revision), name))
                time.sleep(choice.uniform(0.0, 1.5))
        waits.sort(reverse=True)
        for ticks, name in waits[:10]:
            print(f"{ticks} ticks: {name}")
        self.assertLessEqual(waits[0][0], LATE_TICKS)
        self.assertLessEqual(sum(ticks > SOON_TICKS for ticks, _ in waits), MOST_LATE)
        self.assertEqual(list(self.daemon.folder.glob("state/faults/*")), [])


if __name__ == "__main__":
    unittest.main(verbosity=2)
