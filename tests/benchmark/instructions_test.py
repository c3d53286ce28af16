"""The renderer's instructions per tick on fixed slides of 10 000 ticks, counted by callgrind.

They hardly depend on the machine, and not at all on its load. README.md has their history.
"""

import re
import subprocess
import sys
import tempfile
import unittest

COUNTED_TICKS = sys.argv.pop(1)

# Instructions per tick that were reached. What needs less lowers them.
REACHED = {
    ("1", "gyroid_fine_50"): 14_118,
    ("1", "gyroid_coarse_10"): 2_072,
    ("1", "bumps_fine_50"): 13_569,
    ("1", "bumps_coarse_10"): 2_022,
    ("2", "gyroid_fine_50"): 25_772,
    ("2", "bumps_coarse_10"): 2_390,
}
MOST = 1.05  # of them


def instructions_per_tick(refinement, slide):
    with tempfile.NamedTemporaryFile() as profile:
        run = subprocess.run(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={profile.name}",
             "--collect-atstart=no", "--toggle-collect=palpate::CountedTicks*", COUNTED_TICKS,
             refinement, slide],
            check=True, capture_output=True, text=True)
    ticks = int(re.search(r"(\d+) ticks", run.stdout)[1])
    return int(re.search(r"Collected : (\d+)", run.stderr)[1]) / ticks


class Instructions(unittest.TestCase):
    def test_are_not_more_than_were_reached(self):
        for (refinement, slide), reached in REACHED.items():
            with self.subTest(slide, refinement=refinement):
                count = instructions_per_tick(refinement, slide)
                print(f"{slide}, refinement {refinement}: {count:.0f} instructions per tick, "
                      f"{count / reached:.3f} of what was reached")
                # Nothing counted would be few, too.
                self.assertGreater(count, 100)
                self.assertLess(count, MOST * reached)


if __name__ == "__main__":
    unittest.main(verbosity=2)
