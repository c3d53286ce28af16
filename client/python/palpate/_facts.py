"""What is true of the daemon now, told as it changes."""

import collections.abc
import contextlib
import dataclasses
import typing

from palpate._activity import Activity, activity_of
from palpate._device import DeviceInfo, device_info_of
from palpate._held import held_in
from palpate._link import AcknowledgedCall, Link
from palpate._series import SeriesState, series_state_of
from palpate._settings import values_of
from palpate._value_list import RecordingState
from palpate._volume import VolumeInfo, info_of
from palpate._volume_copy import messages_of
from palpate.v1 import facts_pb2, facts_pb2_grpc


@dataclasses.dataclass(frozen=True, eq=False)
class Facts:
    """What is true of the daemon now, besides poses and voxels; Connection.facts().

    settings: by name, as Settings.all() returns them
    settings_revision: Poses.settings_revision has the same numbers
    replayed: a recording is replayed: settings, volume and series are the recorded ones
    not_kept: settings or place could not be written for palpated's next start; volume.warnings
        say why
    volume: None: the first volume still loads
    series: None: no series is loaded
    recording: the present recording, or the last one, and the replay that runs
    device: the device, how it is, and the servo loop
    activity: who is connected, and who changed what
    """

    settings: dict[str, typing.Any]
    settings_revision: int
    replayed: bool
    not_kept: bool
    volume: VolumeInfo | None
    series: SeriesState | None
    recording: RecordingState
    device: DeviceInfo
    activity: Activity


def follow_facts(link: Link) -> collections.abc.Iterator[Facts]:
    """Yields the newest of all facts whenever the daemon tells something new."""
    stub = link.stub(facts_pb2_grpc.FactsServiceStub)
    call = AcknowledgedCall(stub.Follow, facts_pb2.FollowRequest(start=facts_pb2.FollowStart()))
    newest = facts_pb2.Facts()
    with contextlib.closing(messages_of(link, call)) as messages:
        for message in messages:
            for fact, value in message.facts.ListFields():
                getattr(newest, fact.name).CopyFrom(value)
            yield _facts_of(newest)


def _facts_of(newest: facts_pb2.Facts) -> Facts:
    hand = newest.hands.hands[0]
    return Facts(
        settings=values_of(newest.settings.settings),
        settings_revision=newest.settings.settings_revision,
        replayed=newest.settings.replayed, not_kept=newest.settings.not_kept,
        volume=info_of(newest.volume) if newest.HasField("volume") else None,
        series=series_state_of(newest.series) if newest.series.frames else None,
        recording=RecordingState(**held_in(newest.recording)),
        device=device_info_of(hand, newest.hands.servo, newest.caller, hand.led_by),
        activity=activity_of(newest.activity))
