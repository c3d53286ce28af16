"""The force-feedback device and the loop that drives it."""

import dataclasses
import typing

import numpy as np
import numpy.typing as npt

from palpate._enums import DeviceConnection, ForceReason, ForceState, Role, VerificationLevel
from palpate._geometry import Triple, array_of_vector
from palpate._hand import Hand
from palpate._link import Link
from palpate._values import text_of
from palpate.v1 import device_pb2, device_pb2_grpc


@dataclasses.dataclass(frozen=True)
class Forces:
    """The state of the forces, and its reason.

    state: such as "on" or "stopped"; see help(palpate.ForceState)
    reason: why the forces are not on; see help(palpate.ForceReason)
    limit_n: greatest force now, N; less than the device's maximum if the motors are warm
    """

    state: ForceState
    reason: ForceReason
    limit_n: float


@dataclasses.dataclass(frozen=True, eq=False)
class DeviceInfo:
    """The device and the servo loop. Counts start with the daemon.

    kind: configuration name, such as "simulated"
    model: name for people
    workspace_min_mm: (3,) corner of the workspace box in the device frame, mm
    workspace_max_mm: (3,) the opposite corner, mm
    max_force_n: greatest force of the device for a short time, N
    continuous_force_n: greatest force that the device keeps up, N
    max_stiffness_n_per_mm: greatest stiffness that the device renders steadily, N/mm
    position_resolution_mm: smallest motion that the device measures, mm
    button_count: number of buttons
    verification_level: how much of the device's behaviour has been seen on hardware
    connection: whether the device is there
    docked: the stylus is in its place of rest
    calibrated: the device knows where its stylus is
    problem: what is wrong and what to do; empty: nothing
    forces: the state of the forces
    forces_set_by: who enabled, disabled or stopped forces last, and from where, such as
        "token or-2 at ipv4:192.0.2.7:51544"; empty: no client since the daemon's start
    hand_led_by: who leads the simulated hand, as in forces_set_by; empty: it explores by itself,
        or the device is another one
    rate_hz: of the servo loop, Hz
    realtime_scheduling: the system runs the servo before ordinary programs
    memory_locked: the system does not swap the daemon's memory out
    warnings: what the servo lacks and what to do about it
    ticks: ticks of the servo so far
    missed_ticks: ticks skipped because their time had passed
    version: of the daemon
    identity: serial number and firmware as the device reports them; empty: unknown
    caller: the identity that the daemon has verified for this connection, such as "local socket"
    role: what this connection may do; each role may also do everything of the roles before it
    """

    kind: str
    model: str
    workspace_min_mm: npt.NDArray[np.float64]
    workspace_max_mm: npt.NDArray[np.float64]
    max_force_n: float
    continuous_force_n: float
    max_stiffness_n_per_mm: float
    position_resolution_mm: float
    button_count: int
    verification_level: VerificationLevel
    connection: DeviceConnection
    docked: bool
    calibrated: bool
    problem: str
    forces: Forces
    forces_set_by: str
    hand_led_by: str
    rate_hz: float
    realtime_scheduling: bool
    memory_locked: bool
    warnings: tuple[str, ...]
    ticks: int
    missed_ticks: int
    version: str
    identity: str
    caller: str
    role: Role


@dataclasses.dataclass(frozen=True)
class ListedDevice:
    """A device that the daemon could be configured to use.

    kind: configuration name, for palpated.toml
    model: name for people
    port: where the device was found; empty if the device has no port
    usable: the daemon can use the device
    problem: what is missing and what to do; empty if the device is usable
    verification_level: how much of the device's behaviour has been seen on hardware
    in_use: the daemon uses the device now
    """

    kind: str
    model: str
    port: str
    usable: bool
    problem: str
    verification_level: VerificationLevel
    in_use: bool


def _forces_of(status: device_pb2.ForceStatus) -> Forces:
    return Forces(ForceState(status.state), ForceReason(status.reason), status.limit_n)


class Device:
    """The device and its forces; Connection.device.

    Errors: InvalidArgument, FailedPrecondition (what keeps forces off is still there),
    Unavailable.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(device_pb2_grpc.DeviceServiceStub)

    def info(self) -> DeviceInfo:
        """Returns the device, its state and the servo's.

        Errors: Unavailable. Example: print(conn.device.info().forces.state)
        """
        answer = self._link.call(self._stub.GetDevice, device_pb2.GetDeviceRequest())
        device, servo, health = answer.device, answer.servo, answer.health
        return DeviceInfo(
            kind=device.kind, model=device.model,
            workspace_min_mm=array_of_vector(device.workspace_min_mm),
            workspace_max_mm=array_of_vector(device.workspace_max_mm),
            max_force_n=device.max_force_n, continuous_force_n=device.continuous_force_n,
            max_stiffness_n_per_mm=device.max_stiffness_n_per_mm,
            position_resolution_mm=device.position_resolution_mm,
            button_count=device.button_count,
            verification_level=VerificationLevel(device.verification_level),
            connection=DeviceConnection(health.connection), docked=health.docked,
            calibrated=health.calibrated, problem=health.problem, forces=_forces_of(answer.forces),
            forces_set_by=answer.forces_set_by, hand_led_by=answer.hand_led_by,
            rate_hz=servo.rate_hz, realtime_scheduling=servo.realtime_scheduling,
            memory_locked=servo.memory_locked, warnings=tuple(servo.warnings), ticks=servo.ticks,
            missed_ticks=servo.missed_ticks, version=servo.version,
            identity=health.identity, caller=answer.caller.identity,
            role=Role(answer.caller.role))

    def list(self) -> "list[ListedDevice]":
        """Lists the devices of the daemon's machine. Opens no device.

        Errors: Unavailable. Example: [device.model for device in conn.device.list()]
        """
        answer = self._link.call(self._stub.ListDevices, device_pb2.ListDevicesRequest())
        return [ListedDevice(device.kind, device.model, device.port, device.usable, device.problem,
                             VerificationLevel(device.verification_level), device.in_use)
                for device in answer.devices]

    def enable(self, kind: str = "") -> Forces:
        """Enables forces, with a ramp. Also ends an emergency stop, or a fault that has passed.

        kind: configuration name of the device, such as "falcon"; may be empty only if the
        device's forces are verified, or the device is simulated.
        Errors: see help(palpate.Device). Example: conn.device.enable("falcon")
        """
        return self._force_call(self._stub.EnableForces,
                                device_pb2.EnableForcesRequest(device=text_of("kind", kind or "")))

    def disable(self) -> Forces:
        """Ramps forces down to zero. They stay off until they are enabled again.

        Errors: Unavailable. Example: conn.device.disable()
        """
        return self._force_call(self._stub.DisableForces, device_pb2.DisableForcesRequest())

    def stop(self) -> Forces:
        """Emergency stop: zero force within a tick, until forces are enabled again.

        Errors: Unavailable. Example: conn.device.stop()
        """
        return self._force_call(self._stub.StopForces, device_pb2.StopForcesRequest())

    def calibrate(self) -> DeviceInfo:
        """Calibrates the device in its place of rest, when the stylus is docked next.

        Errors: InvalidArgument (the device has no place of rest), FailedPrecondition (the device
        is not there), Unavailable.
        Example: conn.device.calibrate()
        """
        self._link.call(self._stub.CalibrateDevice, device_pb2.CalibrateDeviceRequest())
        return self.info()

    def lead(self, target_mm: Triple | None = None) -> Hand:
        """Takes the hand of the simulated device, to feel without a device.

        target_mm: (3,) where the hand goes first, in the device frame, mm; None: it stays where it
        is.
        Errors: InvalidArgument; see help(palpate.Hand).
        Example: with conn.device.lead() as hand: felt = hand.follow(path_mm, rate_hz=100)
        """
        return Hand(self._link, target_mm)

    def _force_call(self, method: typing.Any, request: typing.Any) -> Forces:
        return _forces_of(self._link.call(method, request).forces)
