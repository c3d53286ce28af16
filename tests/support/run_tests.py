"""python3 -m run_tests MODULE: as python3 -m unittest -v MODULE, with two differences.

- A program that crashed, or did not end when told to, fails the run (crash.py).
- It ends at once. gRPC's threads outlive what they served a little. An interpreter that takes its
  time over its own end may crash in them (grpcio 1.51), which would look like a crash of what is
  tested."""

import os
import sys
import unittest

import crash


def main():
    program = unittest.main(module=None, argv=["run_tests", *sys.argv[1:]], exit=False, verbosity=2)
    for fault in crash.found:
        print(f"FAILED: {fault}")
    sys.stdout.flush()
    sys.stderr.flush()
    passed = program.result.wasSuccessful() and program.result.testsRun and not crash.found
    os._exit(0 if passed else 1)


if __name__ == "__main__":
    main()
