"""What devices send: transfers of a Falcon and readings of an Omni, in scripts of
usb_protocol_fuzz; answers of Haply's service."""

import json
import struct

FALCON, OMNI = b"\0", b"\1"
NAN, INFINITY = float("nan"), float("inf")


def falcon_frame(numbers, flags):
    body = b"".join(bytes(0x41 + (n >> 4 * k & 0xF) for k in range(4)) for n in numbers)
    return b"<" + body + bytes([0x41 + flags, 0x41]) + b">"


def transfer(data):
    """As an FTDI chip sends it: two bytes of status before every 62."""
    packets = [data[at:at + 62] for at in range(0, len(data), 62)] or [b""]
    return b"".join(b"\x31\x60" + packet for packet in packets)


def force(vector, forces_on=True):
    return bytes([3 if forces_on else 1]) + struct.pack("<3d", *vector)


def received(data):
    """A step of a script: half the length must be even."""
    data += b"\x00" * (-len(data) % 4)
    return bytes([len(data) // 2]) + data


def forces(reading):
    """Scripts that push after a reading."""
    return {
        "forces_off": reading + force((1.0, 1.0, 1.0), False),
        "force_not_a_number": reading + force((NAN, 0.0, 1.0)),
        "force_huge": reading + force((1e308, -1e308, 1.0)),
    }


HOMED = 0x70
CENTRE = falcon_frame([-200, -200, -200], HOMED)
ASIDE = falcon_frame([300, -800, 700], HOMED | 0x5)
UNHOMED = falcon_frame([12, -7, 0], 0x10)
NO_POSE = falcon_frame([32767, -32768, 0], HOMED)
PUSH = force((1.0, -0.5, 3.0))


def falcon():
    streams = {
        "status_only": b"",
        "one_frame": CENTRE,
        "unhomed": UNHOMED,
        "angles_that_no_pose_has": NO_POSE,
        "five_frames": CENTRE + ASIDE + UNHOMED + NO_POSE + CENTRE,
        "cut_frame_then_whole": CENTRE[:9] + ASIDE,
        "tail_then_whole": CENTRE[5:] + ASIDE,
        "garbage_between": CENTRE + b"\x00xyz>>" + ASIDE,
        "byte_doubled": CENTRE[:4] + b"A" + CENTRE[4:] + ASIDE,
        "many_begins": b"<" * 20 + CENTRE,
        "many_ends": b">" * 20 + CENTRE,
        "nibble_too_great": CENTRE[:3] + b"Q" + CENTRE[4:] + ASIDE,
    }
    whole = received(transfer(CENTRE))
    scripts = {name: received(transfer(stream)) + PUSH for name, stream in streams.items()}
    return scripts | forces(whole) | {
        "frame_without_status": received(CENTRE) + PUSH,
        "force_before_reading": force((1.0, 1.0, 1.0)) + whole,
        "force_infinite": whole + force((0.0, INFINITY, 1.0)),
        "frame_in_two": received(transfer(CENTRE[:6])) + received(transfer(CENTRE[6:])),
        "homing_lost": whole + received(transfer(UNHOMED)) + force((1.0, 0.0, 0.0)),
    }


def omni_state(encoders, gimbal_a, gimbal_b, status, counter):
    frame = bytearray(44)
    struct.pack_into("<3h", frame, 4, *encoders)
    struct.pack_into("<3H", frame, 10, *gimbal_a)
    frame[19] = status
    struct.pack_into("<3H", frame, 22, *gimbal_b)
    struct.pack_into("<I", frame, 32, counter)
    return bytes(frame)


def omni():
    middle, none, most = (2048,) * 3, (0,) * 3, (65535,) * 3
    rest = [omni_state((10, -20, 30), middle, middle, 0xFB, n) for n in range(1, 51)]
    moved = omni_state((900, -1500, 2000), (100, 4000, 65535), (4000, 100, 1), 0xFC, 52)
    readings = {
        "docked": rest,
        "docked_then_moved": rest + [moved],
        "counter_gap": [moved, omni_state((5, 5, 5), middle, middle, 0xFF, 140)],
        "gimbal_without_voltage": rest + [omni_state((5, 5, 5), none, none, 0xFF, 60)],
        "greatest": [omni_state((32767, -32768, -1), most, most, 0xFF, 2**32 - 1)],
        "wrong_length": [bytes(40)] + rest,
    }
    scripts = {name: b"".join(map(received, those)) + PUSH for name, those in readings.items()}
    return scripts | forces(b"".join(map(received, rest)))


def haply():
    zero, one = {"x": 0.0, "y": 0.0, "z": 0.0}, {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
    place = {"position": zero, "rotation": one, "scale": {"x": 1.0, "y": 1.0, "z": 1.0}}
    state = {"cursor_position": zero, "current_cursor_force": zero, "control_mode": "idle",
             "transform": place}
    config = {"type": "inverse3", "extended_firmware_version": "6.2", "handedness": "right",
              "gravity_compensation": {"enabled": True}, "basis": {"permutation": "XYZ"},
              "mount": place, "filters": {"force_gate": {"gain": 0.3}, "damping": {"scalar": 0}}}
    status = {"calibrated": True, "in_use": False, "power_supply": True, "ready": False}
    arm = {"device_id": "049D", "state": state, "status": status}
    wired = {"device_id": "61F7", "state": {"orientation": one, "button": True}}
    wireless = {"device_id": "61F8", "status": {"awake": False},
                "state": {"orientation": one, "buttons": {"a": True, "c": False}}}
    replies = {
        "reply": {"inverse3": [arm], "verse_grip": [wired]},
        "full": {"inverse3": [arm | {"config": config}], "wireless_verse_grip": [wireless]},
        "old_scale": {"inverse3": [arm | {"state": state | {"transform": {"scale": 2.0}}}]},
        "many": {"inverse3": [arm] * 3, "custom_verse_grip": [wired] * 2},
        "strange_id": {"inverse3": [arm | {"device_id": '"}]}'}]},
        "no_turn": {"verse_grip": [wired | {"state": {"orientation": one | {"w": 0.0}}}]},
        "event": {"name": "device-safety-triggered", "level": "error", "message": "m",
                  "data": {"safety_type": "ebrake_triggered"}},
        "version": {"project_version": "3.5.2"},
        "scale": {"force_scale": 1.0},
    }
    texts = {name: json.dumps(reply) for name, reply in replies.items()}
    return texts | {"number": "0.5", "nested": "[" * 500 + "]" * 500, "great": texts["reply"].replace(
        "0.0", "1e999"), "deep": '{"inverse3":' * 100}


def corpora():
    for name, text in haply().items():
        yield "inverse_messages_fuzz", name, text.encode()
    for name, script in falcon().items():
        yield "usb_protocol_fuzz", f"falcon_{name}", FALCON + script
    for name, script in omni().items():
        yield "usb_protocol_fuzz", f"omni_{name}", OMNI + script
