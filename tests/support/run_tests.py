"""python3 -m run_tests MODULE: as python3 -m unittest -v MODULE, but it ends at once.

gRPC's threads outlive what they served a little. An interpreter that takes its time over its own
end may crash in them (grpcio 1.51), which would look like a crash of what is tested."""

import os
import sys
import unittest

program = unittest.main(module=None, argv=["run_tests", *sys.argv[1:]], verbosity=2, exit=False)
sys.stdout.flush()
sys.stderr.flush()
os._exit(0 if program.result.wasSuccessful() and program.result.testsRun else 1)
