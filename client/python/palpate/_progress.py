"""Progress of a long call, and its cancellation."""

import collections.abc
import contextlib
import typing

from palpate._errors import Cancelled, Internal

# Called with the current step and the share done, 0 to 1. False, or an exception, cancels.
Progress = collections.abc.Callable[[str, float], object]


def tell(progress: collections.abc.Callable[..., object] | None, *told: object) -> None:
    """Calls `progress`. Errors: Cancelled if it returns False."""
    # Compared with False: a progress that returns None does not cancel.
    if progress is not None and progress(*told) is False:
        raise Cancelled("cancelled: progress returned False")


def result_of(events: collections.abc.Generator[typing.Any, None, None],
              progress: Progress | None) -> typing.Any:
    """Reads a stream of progress and returns the result at its end."""
    # Close at once: the traceback of an exception of `progress` would keep the call alive.
    with contextlib.closing(events):
        for event in events:
            if event.HasField("result"):
                return event.result
            tell(progress, event.progress.stage, event.progress.fraction)
    raise Internal("the daemon ended without a result")
