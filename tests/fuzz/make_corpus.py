#!/usr/bin/env python3
"""Writes the corpora of the fuzz targets: small inputs from which a fuzzer starts, named
for what they are. Written against the description of the formats, not with our code."""

import pathlib
import struct
import sys

sys.dont_write_bytecode = True  # the folder is the repository's
import corpus_images
import corpus_recordings
import corpus_state

CORPUS = pathlib.Path(__file__).resolve().parent / "corpus"


def write(target, name, data):
    folder = CORPUS / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)


def falcon_frame(numbers, flags):
    body = b"".join(bytes(0x41 + (n >> 4 * k & 0xF) for k in range(4)) for n in numbers)
    return b"<" + body + bytes([0x41 + flags, 0x41]) + b">"


def transfer(data):
    """As an FTDI chip sends it: two bytes of status before every 62."""
    packets = [data[at:at + 62] for at in range(0, len(data), 62)] or [b""]
    return b"".join(b"\x31\x60" + packet for packet in packets)


HOMED = 0x70
CENTRE = falcon_frame([-200, -200, -200], HOMED)
ASIDE = falcon_frame([300, -800, 700], HOMED | 0x5)
UNHOMED = falcon_frame([12, -7, 0], 0x10)
NO_POSE = falcon_frame([32767, -32768, 0], HOMED)

STREAMS = {
    "status_only": transfer(b""),
    "one_frame": transfer(CENTRE),
    "unhomed": transfer(UNHOMED),
    "angles_that_no_pose_has": transfer(NO_POSE),
    "five_frames": transfer(CENTRE + ASIDE + UNHOMED + NO_POSE + CENTRE),
    "cut_frame_then_whole": transfer(CENTRE[:9] + ASIDE),
    "tail_then_whole": transfer(CENTRE[5:] + ASIDE),
    "garbage_between": transfer(CENTRE + b"\x00xyz>>" + ASIDE),
    "byte_doubled": transfer(CENTRE[:4] + b"A" + CENTRE[4:] + ASIDE),
    "many_begins": transfer(b"<" * 20 + CENTRE),
    "many_ends": transfer(b">" * 20 + CENTRE),
    "nibble_too_great": transfer(CENTRE[:3] + b"Q" + CENTRE[4:] + ASIDE),
}


def force(vector, forces_on):
    return bytes([3 if forces_on else 1]) + struct.pack("<3d", *vector)


def received(data):
    """A step of a script (protocol_script.h): half the length must be even."""
    data += b"\x00" * (-len(data) % 4)
    return bytes([len(data) // 2]) + data


def falcon():
    write("handover_fuzz", "dense", b"\0\x08\0\x04abcd")
    write("handover_fuzz", "tree", b"\x01\x10\0\x04\x02\0\0\0")
    for name, stream in STREAMS.items():
        write("falcon_frames_fuzz", name, stream)
    write("falcon_frames_fuzz", "frame_without_status", CENTRE)
    for name, stream in STREAMS.items():
        script = received(stream) + force((1.0, -0.5, 3.0), True)
        write("falcon_protocol_fuzz", name, script)
    whole = received(transfer(CENTRE))
    half = received(transfer(CENTRE[:6]))
    nan, infinity = float("nan"), float("inf")
    write("falcon_protocol_fuzz", "force_before_reading", force((1.0, 1.0, 1.0), True) + whole)
    write("falcon_protocol_fuzz", "forces_off", whole + force((1.0, 1.0, 1.0), False))
    write("falcon_protocol_fuzz", "force_not_a_number", whole + force((nan, 0.0, 1.0), True))
    write("falcon_protocol_fuzz", "force_infinite", whole + force((0.0, infinity, 1.0), True))
    write("falcon_protocol_fuzz", "force_huge", whole + force((1e308, -1e308, 1.0), True))
    write("falcon_protocol_fuzz", "frame_in_two", half + received(transfer(CENTRE[6:])))
    write("falcon_protocol_fuzz", "homing_lost",
          whole + received(transfer(UNHOMED)) + force((1.0, 0.0, 0.0), True))

    def joints(counts, vector):
        return struct.pack("<3h3d", *counts, *vector)
    write("falcon_kinematics_fuzz", "centre", joints((-200, -200, -200), (0.5, 0.5, 0.5)))
    write("falcon_kinematics_fuzz", "aside", joints((300, -800, 700), (30.0, -20.0, 10.0)))
    write("falcon_kinematics_fuzz", "straight_arms", joints((1300, 1300, 1300), (1.5, 1.5, 1.5)))
    write("falcon_kinematics_fuzz", "folded_arms", joints((-2500, -2500, -2500), (-1.5, -1.5, -1.5)))
    write("falcon_kinematics_fuzz", "greatest_counts", joints((32767, -32768, 0), (1e300, 0, -1e300)))
    write("falcon_kinematics_fuzz", "position_that_overflows", joints((0, 0, 0), (1e200, 5.0, 1e200)))
    write("falcon_kinematics_fuzz", "no_numbers", joints((0, 0, 0), (nan, infinity, -infinity)))


def omni_state(encoders, gimbal_a, gimbal_b, status, counter):
    frame = bytearray(44)
    struct.pack_into("<3h", frame, 4, *encoders)
    struct.pack_into("<3H", frame, 10, *gimbal_a)
    frame[19] = status
    struct.pack_into("<3H", frame, 22, *gimbal_b)
    struct.pack_into("<I", frame, 32, counter)
    return bytes(frame)


def omni():
    tail = struct.pack("<3d3iB", 10.0, -20.0, 30.0, 100, -3000, 2047, 3)
    middle = (2048,) * 3
    rest = omni_state((0, 0, 0), middle, middle, 0xFB, 1)
    write("omni_frames_fuzz", "docked", rest + tail)
    write("omni_frames_fuzz", "moved",
          omni_state((900, -1500, 2000), (100, 4000, 65535), (4000, 100, 1), 0xFC, 2**32 - 1) + tail)
    write("omni_frames_fuzz", "greatest",
          omni_state((32767, -32768, -1), (65535,) * 3, (65535,) * 3, 0xFF, 7) + tail)
    write("omni_frames_fuzz", "gimbal_without_voltage",
          omni_state((1, 2, 3), (0,) * 3, (0,) * 3, 0, 0) + tail)
    write("omni_frames_fuzz", "cut", rest[:30])
    write("omni_frames_fuzz", "no_numbers", rest + struct.pack(
        "<3d3iB", float("nan"), float("inf"), 0.0, 2**31 - 1, -2**31, 0, 255))


def touch_frame(command, payload):
    return b"\xa5\x5a" + bytes([command, len(payload)]) + payload


def touch():
    middle = (2048,) * 3
    docked = touch_frame(0x10, omni_state((10, -20, 30), middle, middle, 0xFB, 1))
    moved = touch_frame(0x10, omni_state((900, -1500, 2000), (100, 4000, 65535), (4000, 100, 1),
                                         0xFC, 2))
    late = touch_frame(0x10, omni_state((5, 5, 5), middle, middle, 0xFF, 40))
    flat = touch_frame(0x10, omni_state((5, 5, 5), (0,) * 3, (0,) * 3, 0xFF, 41))
    streams = {
        "docked": docked,
        "docked_then_moved": docked + moved,
        "counter_gap": moved + late,
        "gimbal_without_voltage": docked + flat,
        "firmware_reply": touch_frame(0x0E, b"FW 1.2".ljust(32, b"\x00")),
        "unknown_command": touch_frame(0x33, b"abc") + docked,
        "empty_payload": touch_frame(0x22, b""),
        "longest_payload": touch_frame(0x44, bytes(range(255))),
        "wrong_length": touch_frame(0x10, bytes(43)) + docked,
        "cut_then_whole": docked[:20] + moved,
        "start_twice": b"\xa5" + docked,
        "header_in_payload": touch_frame(0x44, b"\xa5\x5a\x10\x2c" + bytes(8)) + docked,
        "garbage": b"\x00\xff\x5a\xa5" * 5 + moved,
    }
    for name, stream in streams.items():
        write("omni_usb_frames_fuzz", name, b"\x06" + stream)
        script = received(stream) + force((1.0, -0.5, 3.0), True)
        write("omni_usb_protocol_fuzz", name, script)
    rest = received(docked)
    write("omni_usb_protocol_fuzz", "forces_off", rest + force((1.0, 1.0, 1.0), False))
    write("omni_usb_protocol_fuzz", "force_not_a_number",
          rest + force((float("nan"), 0.0, 1.0), True))
    write("omni_usb_protocol_fuzz", "force_huge", rest + force((1e308, -1e308, 1.0), True))
    write("omni_usb_protocol_fuzz", "frame_in_two", received(docked[:20]) + received(docked[20:]))


if __name__ == "__main__":
    falcon()
    omni()
    touch()
    for source in (corpus_images, corpus_recordings, corpus_state):
        for target, name, data in source.corpora():
            write(target, name, data)
