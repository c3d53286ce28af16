"""python3 -m run_tests MODULE: as python3 -m unittest -v MODULE, with three differences.

- A program that crashed, or did not end when told to, fails the run (crash.py).
- If a busy machine may explain every failure (excuse.py), one line for each says so at the end;
  tests/support/judge.py reads these lines.
- It ends at once. gRPC's threads outlive what they served a little. An interpreter that takes its
  time over its own end may crash in them (grpcio 1.51), which would look like a crash of what is
  tested."""

import os
import sys
import unittest

import crash
import excuse


class Result(unittest.TextTestResult):
    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **named)
        self.excusable, self.final = [], False

    def _judge(self, test, error):
        if issubclass(error[0], excuse.BusyMachine):
            self.excusable.append(test.id())
        else:
            self.final = True

    def addFailure(self, test, err):
        self._judge(test, err)
        super().addFailure(test, err)

    def addError(self, test, err):
        self._judge(test, err)
        super().addError(test, err)

    def addSubTest(self, test, subtest, err):
        if err is not None:
            self._judge(subtest, err)
        super().addSubTest(test, subtest, err)

    def addUnexpectedSuccess(self, test):
        self.final = True
        super().addUnexpectedSuccess(test)


def main():
    program = unittest.main(module=None, argv=["run_tests", *sys.argv[1:]], exit=False,
                            testRunner=unittest.TextTestRunner(verbosity=2, resultclass=Result))
    result = program.result
    for fault in crash.found:
        print(f"FAILED: {fault}")
    if result.excusable and not result.final and not crash.found:
        for name in result.excusable:
            print("***Excusable", name)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0 if result.wasSuccessful() and result.testsRun and not crash.found else 1)


if __name__ == "__main__":
    main()
