"""The force-feedback device and the loop that drives it."""

import dataclasses
import typing

import grpc

from palpate._enums import Role
from palpate._geometry import Triple, vector_of
from palpate._hand import Hand
from palpate._held import fields_in, held_in
from palpate._link import CALL_TIMEOUT_S, Link
from palpate._stop_socket import stop_by_socket, stop_socket_path
from palpate._value_list import (DeviceDescription, DeviceHealth, ForceStatus, ListedDevice,
                                 ServoDescription)
from palpate._values import number, text_of
from palpate.v1 import device_pb2, device_pb2_grpc


_STOP_TIMEOUT_S = 3.0


@dataclasses.dataclass(frozen=True, eq=False)
class DeviceInfo(DeviceHealth, ServoDescription, DeviceDescription):
    __doc__ = f"""The device, how it is, and the servo loop. Counts are since the daemon's start.

    {fields_in(DeviceDescription)}
    {fields_in(ServoDescription)}
    {fields_in(DeviceHealth)}
    forces: the state of the forces
    forces_set_by: who enabled, disabled or stopped forces last, and from where, such as
        "token or-2 at ipv4:192.0.2.7:51544"; empty: no client since the daemon's start
    hand_led_by: who leads the simulated hand, as in forces_set_by; empty: it explores by itself,
        or the device is another one
    caller: the identity that the daemon has verified for this connection, such as "local socket"
    role: what this connection may do; each role may also do everything of the roles before it
    """

    forces: ForceStatus
    forces_set_by: str
    hand_led_by: str
    caller: str
    role: Role

    # Arrays cannot be compared with ==.
    __eq__ = object.__eq__
    __hash__ = object.__hash__


def device_info_of(hand: device_pb2.Hand | device_pb2.GetDeviceResponse,
                   servo: device_pb2.ServoDescription, caller: device_pb2.CallerDescription,
                   led_by: str) -> DeviceInfo:
    return DeviceInfo(
        **held_in(hand.device), **held_in(servo), **held_in(hand.health),
        forces=ForceStatus(**held_in(hand.forces)), forces_set_by=hand.forces_set_by,
        hand_led_by=led_by, caller=caller.identity, role=Role(caller.role))


class Device:
    """The device and its forces; Connection.device.

    Errors: InvalidArgument, FailedPrecondition (what keeps forces off is still there),
    Unavailable.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(device_pb2_grpc.DeviceServiceStub)
        self._stop_stub = link.stop_stub(device_pb2_grpc.DeviceServiceStub)

    def info(self) -> DeviceInfo:
        """Returns the device, its state and the servo's.

        Errors: Unavailable. Example: print(conn.device.info().forces.state)
        """
        answer = self._link.call(self._stub.GetDevice, device_pb2.GetDeviceRequest())
        return device_info_of(answer, answer.servo, answer.caller, answer.hand_led_by)

    def list(self) -> "list[ListedDevice]":
        """Lists the devices of the daemon's machine. Opens no device.

        Errors: Unavailable. Example: [device.model for device in conn.device.list()]
        """
        answer = self._link.call(self._stub.ListDevices, device_pb2.ListDevicesRequest())
        return [ListedDevice(**held_in(device)) for device in answer.devices]

    def enable(self, kind: str = "") -> ForceStatus:
        """Enables forces, with a ramp. Also ends an emergency stop, or a fault that has passed.

        kind: configuration name of the device, such as "falcon"; may be empty only if the
        device's forces are verified, or the device is simulated.
        Errors: see help(palpate.Device). Example: conn.device.enable("falcon")
        """
        return self._force_call(self._stub.EnableForces,
                                device_pb2.EnableForcesRequest(device=text_of("kind", kind or "")))

    def disable(self) -> ForceStatus:
        """Ramps forces down to zero. They stay off until they are enabled again.

        Errors: Unavailable. Example: conn.device.disable()
        """
        return self._force_call(self._stub.DisableForces, device_pb2.DisableForcesRequest())

    def stop(self) -> ForceStatus:
        """Emergency stop: zero force within a tick, until forces are enabled again.

        Where palpated is reached by its socket, by another socket for that alone; over TCP on a
        connection for that alone.
        Errors: Unavailable. Example: conn.device.stop()
        """
        self._link.check_open()
        if self._link.socket_path:
            stopped = stop_by_socket(stop_socket_path(self._link.socket_path))
            if stopped is not None:
                return stopped
        request = device_pb2.StopForcesRequest()
        try:
            return ForceStatus(**held_in(
                self._stop_stub.StopForces(request, timeout=_STOP_TIMEOUT_S).forces))
        except grpc.RpcError:  # such as one connection too many
            return self._force_call(self._stub.StopForces, request, _STOP_TIMEOUT_S)

    def calibrate(self, kind: str = "") -> DeviceInfo:
        """Calibrates the device in its place of rest, when the stylus is docked next.

        kind: configuration name of the device. Needed if calibration_moves_arm: its arm then
        moves by itself, 3 s later. Keep clear of it.
        Errors: InvalidArgument (the device has no calibration, or is not named),
        FailedPrecondition (the device is not there, or its forces are on), Unavailable.
        Example: conn.device.calibrate()
        """
        self._link.call(self._stub.CalibrateDevice,
                        device_pb2.CalibrateDeviceRequest(device=text_of("kind", kind or "")))
        return self.info()

    def push(self, force_n: Triple, seconds: float = 0.5) -> int:
        """Puts a small constant force on the hand, to try the motors. Returns its first tick.

        force_n: (3,) in the device frame, at most 0.5 N long. seconds: at most 5. Of any 10 s,
        pushes of all clients together take at most 5 s.
        Errors: InvalidArgument, TooLarge (pushes have taken that), FailedPrecondition (the forces
        do not act), Conflict (a recording is replayed), Unavailable.
        Example: conn.device.push((0, 0.3, 0))
        """
        request = device_pb2.PushHandRequest(force_n=vector_of("force_n", force_n),
                                             seconds=number("seconds", seconds))
        return int(self._link.call(self._stub.PushHand, request).applied_tick)

    def lead(self, target_mm: Triple | None = None) -> Hand:
        """Takes the hand of the simulated device, to feel without a device.

        target_mm: (3,) where the hand goes first, in the device frame, mm; None: it stays where it
        is.
        Errors: InvalidArgument; see help(palpate.Hand).
        Example: with conn.device.lead() as hand: felt = hand.follow(path_mm, rate_hz=100)
        """
        return Hand(self._link, target_mm)

    def _force_call(self, method: typing.Any, request: typing.Any,
                    timeout_s: float = CALL_TIMEOUT_S) -> ForceStatus:
        return ForceStatus(**held_in(self._link.call(method, request, timeout_s).forces))
