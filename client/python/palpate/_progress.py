"""Progress of a call that takes long, and its cancellation."""

import collections.abc
import contextlib
import typing

from palpate._errors import Cancelled, Internal

# Called with what is done and the share done, 0 to 1. False, or an exception, cancels.
Progress = collections.abc.Callable[[str, float], object]


def tell(progress: collections.abc.Callable[..., object] | None, *told: object) -> None:
    """Calls it. Errors: Cancelled where it returns False."""
    # Not `not`: a progress that returns None goes on.
    if progress is not None and progress(*told) is False:
        raise Cancelled("cancelled: progress returned False")


def result_of(events: collections.abc.Generator[typing.Any, None, None],
              progress: Progress | None) -> typing.Any:
    """The result at the end of a stream of progress."""
    # Closed at once: an exception of `progress` would keep the call until its traceback is gone.
    with contextlib.closing(events):
        for event in events:
            if event.HasField("result"):
                return event.result
            tell(progress, event.progress.stage, event.progress.fraction)
    raise Internal("the daemon ended without a result")
