"""Files that the daemon keeps, and the stream of a volume."""

import struct

HAPTICS = """method = "tpbcc"
free_side = "above"
stiffness_n_per_mm = 0.5
force_shading = true
"""


def session(volume="", configured="", haptics=HAPTICS, attempts="1"):
    return f"""# a remark
attempts = {attempts}
[configured]
source = "builtin:bumps"
isovalue = 0.25
device_mm_per_volume_mm = 2.0
{configured}
[configured.haptics]
{HAPTICS}
[volume]
source = "/data/a volume.nrrd"
title = "first"
isovalue = -100.5
{volume}
[haptics]
{haptics}"""


def layers(*named):
    return "".join(f'[[haptics.layer]]\nname = "{name}"\nid = {n + 1}\nisovalue = {isovalue}\npop_force_n = 0.2\n'
                   for n, (name, isovalue) in enumerate(named))


def tool(center="[0, 0, 1]", radius="1.5", count="3"):
    return f"""[haptics.tool]
name = "drill"
rotation_length_mm = 30
[[haptics.tool.ball]]
center_mm = {center}
radius_mm = {radius}
carves = true
[[haptics.tool.line]]
from_mm = [0, 0, 4]
to_mm = [0, 0, 9]
count = {count}
radius_mm = 0
"""


def sessions():
    raw = "raw = {{ size = [{}], type = \"int16\", big_endian = true, offset_bytes = 16 }}"
    return {
        "plain": session(),
        "raw": session(volume=raw.format("64, 64, 32")),
        "raw_size_that_overflows": session(volume=raw.format("1e300, -1e300, 2")),
        "raw_size_not_a_number": session(volume=raw.format("nan, inf, 2")),
        "spacing": session(volume="spacing_mm = [0.5, 1, 2.5]\nframe = 3"),
        "spacing_of_words": session(volume="spacing_mm = [0.5, '1', 2.5]"),
        "frame_as_text": session(volume="frame = 'first'"),
        "attempts_that_overflow": session(attempts="9223372036854775807"),
        "attempts_as_text": session(attempts="'many'"),
        "settings_not_a_number": session(haptics="stiffness_n_per_mm = nan\npop_force_n = -inf"),
        "unknown_setting": session(haptics="tomorrow = 1"),
        "no_isovalue": session().replace("isovalue = -100.5", ""),
        "no_haptics": session()[:-len(HAPTICS) - 10],
        "odd_names": session(configured='title = "\\u0000\\u001b[31m\\U0001F600"'),
        "layers": session(haptics=HAPTICS + layers(("skin", 0.1), ("bone", 0.5))),
        "layers_out_of_order": session(haptics=HAPTICS + layers(("bone", 0.5), ("", "nan"), ("skin", 0.1))),
        "tool": session(haptics=HAPTICS + tool()),
        "tool_in_nothing": session(haptics=HAPTICS + tool(center="[nan, inf, 0]", radius="-1e300")),
        "tool_of_many": session(haptics=HAPTICS + tool(count="9223372036854775807")),
        "key_twice": session(volume="frame = 1\nframe = 2"),
        "no_utf8": session(volume="x = 'ab'").encode().replace(b"ab", b"\xff\xfe"),
        "deep": "a = " + "[" * 300,
        "cut": session()[:200],
        "empty": "",
    }


def registration(**other):
    fields = {"source": '"/data/a.nrrd"', "size": "[10, 20, 30]", "spacing_mm": "[0.5, 0.5, 1.0]",
              "center_mm": "[1.0, -2.0, 30.0]", "rotation_wxyz": "[1.0, 0.0, 0.0, 0.0]",
              "device_mm_per_volume_mm": "0.8"}
    fields.update(other)
    return "[[registration]]\n" + "".join(f"{key} = {value}\n" for key, value in fields.items() if value)


def registrations():
    return {
        "one": registration(), "two": registration() + registration(source='"builtin:bumps"'),
        "incomplete_beside_a_good_one": registration(size=None) + registration(),
        "line_end_in_the_complaint": "gist= n\nn\n",
        "size_below_1": registration(size="[0, -1, 5]"), "size_huge": registration(size="[1e300, 1, 1]"),
        "size_not_a_number": registration(size="[nan, 1, 1]"), "spacing_0": registration(spacing_mm="[0, 0, 0]"),
        "rotation_0": registration(rotation_wxyz="[0, 0, 0, 0]"),
        "rotation_not_a_number": registration(rotation_wxyz="[nan, 0, 0, 1]"),
        "scale_huge": registration(device_mm_per_volume_mm="1e308"),
        "center_far": registration(center_mm="[1e300, 0, 0]"), "no_tables": "registration = [1, 'a', {}]\n",
        "no_array": "registration = 1\n", "other": "other = 1\n", "empty": "",
    }


def token(**other):
    fields = {"name": '"lab-1"', "role": '"editor"', "salt": f'"{"0a" * 16}"', "sha256": f'"{"f3" * 32}"'}
    fields.update(other)
    return "[[token]]\n" + "".join(f"{key} = {value}\n" for key, value in fields.items() if value)


def tokens():
    return {
        "one": token(), "two": token() + token(name='"b"', role='"admin"'), "same_name": token() * 2,
        "no_role": token(role='"king"'), "no_name": token(name=None), "odd_name": token(name='"a b"'),
        "long_name": token(name=f'"{"a" * 65}"'), "short_salt": token(salt='"0a"'),
        "no_hex": token(salt=f'"{"0g" * 16}"'), "other_key": token(other="1"), "a_table": "[token]\nname = 'a'\n",
        "numbers": "token = [1, 2]\n", "empty": "",
    }


# Types of voxels, in the order of LeafType.
UINT8, INT16, UINT16, FLOAT = range(4)


def lattice(*size, low=-1.0, high=1.0, kind=FLOAT):
    return b"\0" + struct.pack("<3i2dB", *size, low, high, kind)


def floats(count):
    return struct.pack("<H", 2 * count)


def raw(data):
    return struct.pack("<H", 2 * len(data) + 1) + data


def overview(size, first, values):
    return b"\2" + struct.pack("<3iQ", *size, first) + values


def bricks(numbers, values, left=0, kind=FLOAT, tiles=()):
    return (b"\3" + struct.pack(f"<B{len(numbers)}i2B", len(numbers), *numbers, kind, len(tiles)) +
            b"".join(struct.pack("<2if", *tile) for tile in tiles) + struct.pack("<I", left) + values)


def complete(revision=4, low=0):
    return b"\4" + struct.pack("<2Q", revision, low)


def streams():
    begun = lattice(10, 8, 17)
    most = 2**31 - 1
    return {
        "whole": begun + b"\1" + bytes(8) + overview((3, 2, 5), 0, floats(30)) + bricks((0, 3, 5), floats(1536), 2) +
                 complete(),
        "overview_in_parts": begun + overview((3, 2, 5), 0, floats(11)) + overview((3, 2, 5), 11, floats(19)),
        "overview_too_long": begun + overview((3, 2, 5), 0, floats(31)),
        "overview_with_a_gap": begun + overview((3, 2, 5), 2**64 - 1, floats(3)),
        "overview_of_another_size": begun + overview((3, 2, -5), 0, floats(3)),
        "brick_outside": begun + bricks((6,), floats(512)), "brick_below_0": begun + bricks((-1,), floats(512)),
        "bricks_twice": begun + bricks((1, 1), floats(1024)), "no_bricks": begun + bricks((), floats(0)),
        "bricks_left": begun + bricks((1,), floats(512), 7), "values_too_few": begun + bricks((1,), floats(511)),
        "values_damaged": begun + bricks((1,), raw(b"\x28\xb5\x2f\xfd\x60\x00\x07")),
        # As many bytes as bricks of these types have: half and a quarter of the floats.
        "int16": begun + bricks((1, 2), floats(512), kind=INT16) + complete(),
        "uint8": lattice(10, 8, 17, kind=UINT8) + bricks((4,), floats(128), kind=UINT8, tiles=[(0, 4, 7.0)]) +
                 complete(),
        "uint16_too_long": begun + bricks((1,), floats(512), kind=UINT16),
        "tiles": begun + bricks((), floats(0), tiles=[(0, 2, 0.5), (2, 4, float("nan"))]) + complete(),
        "tiles_overlap": begun + bricks((), floats(0), tiles=[(0, 3, 0.5), (2, 2, 1.0)]),
        "tile_beyond": begun + bricks((), floats(0), tiles=[(5, 2, 0.5)]),
        "tile_of_nothing": begun + bricks((), floats(0), tiles=[(5, 0, 0.5)]),
        "tile_wraps": begun + bricks((), floats(0), tiles=[(5, -1, 0.5)]),
        "brick_in_a_tile": begun + bricks((3,), floats(512), tiles=[(2, 3, 0.5)]),
        "before_the_lattice": bricks((0,), floats(512)) + complete() + overview((1, 1, 1), 0, floats(1)),
        "another_lattice": begun + bricks((0,), floats(512)) + lattice(2, 3, 4) + complete(),
        "another_hash": begun + complete(low=5), "no_voxels": lattice(0, 8, 8), "below_0": lattice(-8, -8, 8),
        "long": lattice(most, 1, 1), "huge": lattice(most, most, most), "thin": lattice(1, 1, 1 << 14),
        "range_not_a_number": lattice(8, 8, 8, low=float("nan")),
    }


def corpora():
    # In the order of state_file_fuzz.cpp.
    kinds = {"session": sessions(), "registration": registrations(), "token": tokens()}
    for number, (kind, files) in enumerate(kinds.items()):
        for name, data in files.items():
            data = data.encode() if isinstance(data, str) else data
            yield "state_file_fuzz", f"{kind}_{name}", bytes([number]) + data
    for name, data in streams().items():
        yield "volume_mirror_fuzz", name, data
