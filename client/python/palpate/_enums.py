"""The enumerations of palpate.v1, with the same numbers. 0 is never sent."""

import enum


class Word(enum.IntEnum):
    """An enumeration. A member's str() is its word on the command line, and it equals that word.

    The numbers are for arrays, such as Poses.mode. The hash is the number's: a dictionary finds a
    member by its number, but not by its word.
    """

    def __str__(self) -> str:
        return self.name.lower().replace("_", "-")

    def __format__(self, spec: str) -> str:
        return format(str(self), spec)

    def __eq__(self, other: object) -> bool:
        return str(self) == other if isinstance(other, str) else int.__eq__(self, other)

    def __ne__(self, other: object) -> bool:
        return str(self) != other if isinstance(other, str) else int.__ne__(self, other)

    __hash__ = int.__hash__


class ProxyMode(Word):
    """State of the proxy (SCP_H) in a tick.

    FREE: in free space, no force
    CONSTRAINED: held by the surface
    EJECTING: the surface moved over the proxy, and the proxy is being moved out
    FAULT: forces are off because of a fault
    SUSPENDED: forces are off while the stylus moves the volume, or a recording is replayed
    INSIDE: the stylus is inside the object, and nothing is felt until it is pulled out
    """

    FREE = 1
    CONSTRAINED = 2
    EJECTING = 3
    FAULT = 4
    SUSPENDED = 5
    INSIDE = 6


class FreeSide(Word):
    """Side of the isosurface on which the stylus is free.

    BELOW: where values are below the isovalue
    ABOVE: where values are above it: a cavity is felt from the inside
    """

    BELOW = 1
    ABOVE = 2


class DecompositionMethod(Word):
    """How the cells of the volume are cut into tetrahedra; see help(palpate.Settings).

    TPBCC keeps the surface's topology, BCC does not.
    """

    BCC = 1
    TPBCC = 2


class ForceState(Word):
    """The state of the forces.

    OFF: not enabled, or disabled
    RAMP_IN: enabled, and rising to the full limit
    ON: enabled
    HELD: off while something is not right; they come back by themselves
    FAULT: cut off; on hardware, until they are enabled again
    STOPPED: cut off by the emergency stop, until they are enabled again
    """

    OFF = 1
    RAMP_IN = 2
    ON = 3
    HELD = 4
    FAULT = 5
    STOPPED = 6


class ForceReason(Word):
    """The reason of the state of the forces.

    NONE: they are on
    OPERATOR: off: never enabled, or disabled
    DOCKED: held: the stylus is in its place of rest
    UNCALIBRATED: held: the position has no meaning yet
    STALE: held: readings are late
    DEADLINES: held: the servo missed its deadlines
    DEVICE: fault: the device is gone or broken
    POSITION: fault: the position is invalid
    FORCE: fault: the force is not finite
    SPEED: fault: the stylus moves faster than a hand
    STOP_CALL: stopped by a call
    STOP_BUTTON: stopped by the stylus's buttons
    REPLAY: held: a recording is replayed to viewers; they come back at its end
    """

    NONE = 1
    OPERATOR = 2
    DOCKED = 3
    UNCALIBRATED = 4
    STALE = 5
    DEADLINES = 6
    DEVICE = 7
    POSITION = 8
    FORCE = 9
    SPEED = 10
    STOP_CALL = 11
    STOP_BUTTON = 12
    REPLAY = 13


class DeviceConnection(Word):
    """Whether the device is there.

    ABSENT: not found, or cannot be opened; the daemon keeps looking for it
    CONNECTING: found, and being opened
    STREAMING: it sends its position
    """

    ABSENT = 1
    CONNECTING = 2
    STREAMING = 3


class VerificationLevel(Word):
    """How much of a device's behaviour has been seen on hardware."""

    NONE = 1
    ENUMERATED = 2
    IDENTIFIED = 3
    STATE_READ = 4
    FORCE_VERIFIED = 5
    SIMULATED = 6


class Role(Word):
    """What a client may do. Each role may also do everything of the roles before it.

    A viewer watches. An editor changes settings, voxels and the place. An operator drives the
    device, loads, saves and records.
    """

    VIEWER = 1
    EDITOR = 2
    OPERATOR = 3
    ADMIN = 4


class ForceCommand(Word):
    """The command that the safety stage got in a recorded tick."""

    NONE = 1
    ENABLE = 2
    DISABLE = 3
    STOP = 4


class DeviceStatus(Word):
    """The device's position in a recorded tick: fresh, old, or missing."""

    OK = 1
    STALE = 2
    FAULT = 3
