"""Time series: volumes of one lattice, played under the stylus."""

import collections.abc
import dataclasses
import os

from palpate._errors import InvalidArgument
from palpate._geometry import Triple
from palpate._link import Link
from palpate._load_options import Changes, Raw, load_options
from palpate._progress import Progress, result_of
from palpate._values import number, number_or_none, switch
from palpate.v1 import series_pb2, series_pb2_grpc


@dataclasses.dataclass(frozen=True)
class SeriesState:
    """A series and its position.

    frames: number of frames
    position_frames: 0 is the first; between two frames if the series is interpolated
    playing: False: paused
    rate_hz: frames per second, negative backwards
    loop: at its end, playing begins again
    interpolate: neighbouring frames are blended in time
    memory_bytes: memory of all frames on the daemon's machine, bytes
    volume_revision: of the frame under the stylus
    replayed: a recording is replayed: position_frames is the recorded one
    applied_tick: of a load or a change: first tick that used this frame; Poses.tick has the same
        numbers. If the frame was there already, a tick that used it. None: nothing was changed
    """

    frames: int
    position_frames: float
    playing: bool
    rate_hz: float
    loop: bool
    interpolate: bool
    memory_bytes: int
    volume_revision: int
    replayed: bool
    applied_tick: int | None = None


def series_state_of(series: series_pb2.SeriesState,
                    applied_tick: int | None = None) -> SeriesState:
    return SeriesState(series.frames, series.position_frames, series.playing, series.rate_hz,
                       series.loop, series.interpolate, series.memory_bytes,
                       series.volume_revision, series.replayed, applied_tick)


class Series:
    """The time series of the daemon; Connection.series.

    Errors: Conflict if none is loaded, InvalidArgument, Unavailable.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(series_pb2_grpc.SeriesServiceStub)

    def load(self, sources: str | os.PathLike[str] | collections.abc.Iterable[
            str | os.PathLike[str]], *, isovalue: float | None = None,
             normalized_isovalue: float | None = None, spacing_mm: Triple | None = None,
             device_mm_per_volume_mm: float | None = None, grid: str = "", component: str = "",
             raw: Raw | None = None, discard_edits: bool = False,
             settings: Changes | None = None, progress: Progress | None = None) -> SeriesState:
        """Loads all frames, puts the first under the stylus and pauses there.

        sources: paths on the daemon's machine, in the order of time: files of one frame each, or
        one file with several frames. The matches of a pattern with * and ? are sorted by the
        numbers in their names. Relative paths, the other arguments (for all frames) and errors:
        as in VolumeAccess.load.
        Example: conn.series.load("/data/heart-*.nrrd", isovalue=300)
        """
        if isinstance(sources, (str, os.PathLike)):
            sources = [sources]
        if not isinstance(sources, collections.abc.Iterable):
            raise InvalidArgument(f"sources are paths of files, not {sources!r}")
        request = series_pb2.LoadSeriesRequest(
            sources=[self._link.path(source) for source in sources],
            options=load_options(isovalue, normalized_isovalue, device_mm_per_volume_mm,
                                 spacing_mm, None, grid, component, raw, discard_edits, settings))
        events = self._link.events(self._stub.LoadSeries, request)
        result = result_of(events, progress)
        return series_state_of(result.series, result.applied_tick)

    def state(self) -> SeriesState:
        """Returns the series and its position. Errors: see help(palpate.Series).

        Example: conn.series.state().position_frames
        """
        answer = self._link.call(self._stub.GetSeries, series_pb2.GetSeriesRequest())
        return series_state_of(answer.series)

    @property
    def rate_hz(self) -> float:
        """The speed in frames per second: -1000 to 1000, not 0, negative backwards.

        Can also be set while paused. At most 60 volumes per second are shown; frames in between
        are skipped. Errors: see help(palpate.Series). Example: conn.series.rate_hz = -12.5
        """
        return self.state().rate_hz

    @rate_hz.setter
    def rate_hz(self, value: float) -> None:
        self._control(series_pb2.ControlSeriesRequest(rate_hz=number("rate_hz", value)))

    def play(self, rate_hz: float | None = None) -> SeriesState:
        """Plays from the present position on.

        rate_hz: frames per second, -1000 to 1000, not 0, negative backwards; None: as before.
        Errors: see help(palpate.Series). Example: conn.series.play(25)
        """
        return self._control(series_pb2.ControlSeriesRequest(
            playing=True, rate_hz=number_or_none("rate_hz", rate_hz)))

    def pause(self) -> SeriesState:
        """Pauses at the present frame. Errors: see help(palpate.Series).

        Example: conn.series.pause()
        """
        return self._control(series_pb2.ControlSeriesRequest(playing=False))

    def seek(self, position_frames: float) -> SeriesState:
        """Goes to a frame. Returns when the servo uses it.

        position_frames: 0 to frames - 1; may be a fraction if the series is interpolated.
        Errors: see help(palpate.Series). Example: conn.series.seek(0).applied_tick
        """
        return self._control(series_pb2.ControlSeriesRequest(
            position_frames=number("position_frames", position_frames)))

    def configure(self, *, loop: bool | None = None,
                  interpolate: bool | None = None) -> SeriesState:
        """Changes how the series is played. None: as before.

        loop: begin again at the end. interpolate: blend neighbouring frames in time.
        Errors: see help(palpate.Series). Example: conn.series.configure(loop=True)
        """
        request = series_pb2.ControlSeriesRequest()
        if loop is not None:
            request.loop = switch("loop", loop)
        if interpolate is not None:
            request.interpolate = switch("interpolate", interpolate)
        return self._control(request)

    def _control(self, request: series_pb2.ControlSeriesRequest) -> SeriesState:
        answer = self._link.call(self._stub.ControlSeries, request)
        return series_state_of(answer.series, answer.applied_tick)
