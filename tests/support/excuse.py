"""The one excuse for a test that fails: a busy machine."""

import contextlib


class BusyMachine(AssertionError):
    """An assertion failed that a busy machine alone can fail."""


@contextlib.contextmanager
def busy_machine_may_explain():
    """Around an assertion about a latency, a rate or a count, and nothing else: if only such
    assertions fail, tests/run.sh runs the file again. Never around one about a force, a role or a
    copy: a slow machine does not change those."""
    try:
        yield
    except AssertionError as error:
        if type(error) is not AssertionError:  # a crash, say
            raise
        raise BusyMachine(*error.args).with_traceback(error.__traceback__) from None
