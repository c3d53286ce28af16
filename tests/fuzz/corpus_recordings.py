"""Recordings, their chunks and states of the servo, from the descriptions in
server/recording and server/servo; checksums are left to the targets."""

import struct

NAN, INFINITY = float("nan"), float("inf")
SAMPLES, SCENE, EDIT, MARKER, GAP, KEYFRAME, END = range(1, 8)
HERE = (-16.5, -13.5, -12.0)  # of voxel (0, 0, 0) in D


def text(words):
    data = words.encode() if isinstance(words, str) else words
    return struct.pack("<I", len(data)) + data


def settings(**changes):
    values = {"stiffness_n_per_mm": "0.5", "damping_n_s_per_m": "0", "static_friction": "0.6",
              "dynamic_friction": "0.4", "pop_force_n": "0", "magnet_force_n": "0.5",
              "magnet_range_mm": "2", "force_shading": "on", "passivity_control": "on",
              "free_side": "below"}
    values.update(changes)
    return "".join(f"{key}={value}\n" for key, value in values.items())


def scene(tick=0, revision=1, settings_revision=1, volume=1, loaded=1, geometry=1, isovalue=0.5,
          words=None, method="tpbcc", linear=(3, 0, 0, 0, 3, 0, 0, 0, 3), translation=HERE, missing=0,
          period=0.001, limits=(3.3, 200, 0, 0, 0, 0, 0), forces_off=0):
    return b"".join((
        struct.pack("<6Q2d", tick, revision, settings_revision, volume, loaded, geometry, isovalue, isovalue),
        text(settings() if words is None else words), text(method), struct.pack("<12d", *linear, *translation),
        struct.pack("<2Q", 1, 2), text("builtin:small"), struct.pack("<3dBd", 1, 1, 1, missing, period),
        struct.pack("<7d2BI", *limits, 0, 1, 0), struct.pack("<B", forces_off)))


def place(kind=2, cell=(4, 4, 4), faces=0x15, p_I=(4, 4, 4), vertices=(0,), weights=(1.0,), count=None,
          tetrahedron=-1):
    count = len(weights) if count is None else count
    vertices = (tuple(vertices) + (0,) * 4)[:4]
    weights = (tuple(weights) + (0.0,) * 4)[:4]
    return struct.pack("<B3iB3di4B4di", kind, *cell, faces, *p_I, count, *vertices, *weights, tetrahedron)


def keyframe(tick=0, placed=1, on_surface=1, buried=0, where=None, p_DH=(-4.5, -1.5, 0), geometry=1,
             volume=1, loaded=1, side=0, isovalue=0.5, has_hip=1, hip=(-4.5, -1.5, 0.1), last=None, velocity=(0, 0, 0),
             normal=(0, 0, -1), positions=0, newest=0, layout=5, times=(0,) * 10):
    zero = (0.0, 0.0, 0.0)
    proxy = struct.pack("<3B", placed, on_surface, buried) + (place() if where is None else where) + (
        struct.pack("<3d3QBd", *p_DH, geometry, volume, loaded, side, isovalue))
    state = struct.pack("<B9dB3dB3d", has_hip, *hip, *(hip if last is None else last), *velocity, 1, *normal, 0,
                        0, 0, 0)
    passivity = struct.pack("<B4d12d30d10d2i4d", 0, 0, 0, 0, 1, *zero * 4, *zero * 10, *times, positions, newest,
                            *zero, 0)
    safety = struct.pack("<5B14d", 2, 0, 0, 0, has_hip, *zero, *hip, *zero, 0, 0, 0, 0, 0)
    return struct.pack("<B", layout) + proxy + state + passivity + struct.pack("<12d", *zero * 4) + safety + (
        struct.pack("<4Q", tick, 0, 0, 0))


def fields(tick, hip=(0.0, 0.0, 0.0), mode=0, scene_revision=1):
    """Of a sample: size and bits."""
    double = lambda x: (8, struct.unpack("<Q", struct.pack("<d", x))[0])
    return [(8, tick), (8, 1000 * tick), (1, mode), (1, 0), (1, 0), (1, 0), *map(double, hip + hip + (0, 0, 1)),
            (1, 0), *map(double, (0,) * 6), *map(double, (0, 0, 0.5)), *map(double, (1, 0, 0, 0)), (4, 0),
            double(0.5), double(0.5), (8, scene_revision), (8, 1), (8, 1), (8, 17000), (4, 3), (8, 0), (8, 0), (8, 0),
            (1, 2), (1, 0), (1, 0), double(3.3), (1, 0), (1, 0), (1, 1)]


def samples(rows):
    columns = []
    for column in zip(*rows):
        size, last, folded = column[0][0], 0, []
        for _, bits in column:
            difference = (bits - last) % (1 << 8 * size)
            last = bits
            negative = difference >> (8 * size - 1)
            folded.append(((difference << 1) ^ (-negative)) % (1 << 8 * size))
        for k in range(size):
            columns.append(bytes(f >> 8 * k & 0xff for f in folded))
    return struct.pack("<I", len(rows)) + b"".join(columns)


def edit(numbers=(0, 5), base=1, revision=2, tick=3, planes=None):
    planes = bytes(4 * 512 * len(numbers)) if planes is None else planes
    return struct.pack(f"<3QI{len(numbers)}Q", tick, base, revision, len(numbers), *numbers) + planes


def chunks():
    rows = [fields(7 + n, (0.1 * n, -n, 3e8)) for n in range(3)]
    gap = lambda first, last: (GAP, struct.pack("<2Q", first, last))
    marker = lambda words: (MARKER, struct.pack("<Qq", 3, 99) + text(words))
    return {
        "samples": (SAMPLES, samples(rows)),
        "sample": (SAMPLES, samples(rows[:1])),
        "samples_with_a_gap": (SAMPLES, samples([rows[0], rows[2]])),
        "samples_no_mode": (SAMPLES, samples([fields(1, mode=6)])),
        "samples_too_many": (SAMPLES, struct.pack("<I", 0xffffffff)),
        "scene": (SCENE, scene()),
        "scene_unknown_setting": (SCENE, scene(words=settings(a_new_one="1"))),
        "scene_no_number": (SCENE, scene(words=settings(pop_force_n="much"))),
        "scene_not_a_number": (SCENE, scene(words=settings(pop_force_n="-nan"))),
        "scene_many_unknown_settings": (SCENE, scene(words="=\n" * 1000)),
        "scene_of_no_method": (SCENE, scene(method="best")),
        "edit": (EDIT, edit()),
        "edit_out_of_order": (EDIT, edit((5, 0))),
        "edit_cut": (EDIT, edit((0,))[:-1]),
        "edit_too_many": (EDIT, struct.pack("<3QI", 1, 1, 1, 0xffffffff)),
        "marker": marker("here, \"now\"\n"),
        "marker_long": marker("x" * 4000),
        "gap": gap(4, 9),
        "gap_backwards": gap(9, 4),
        "gap_of_everything": gap(0, 2**64 - 1),
        "keyframe": (KEYFRAME, struct.pack("<Q", 0) + text(keyframe())),
        "keyframe_length": (KEYFRAME, struct.pack("<QI", 0, 0xffffffff)),
        "end": (END, struct.pack("<2Q", 10, 0)),
        "unknown": (8, b""),
    }


def zstd(data, size=None):
    """A frame of one block that is not compressed; or of one byte again and again."""
    frame = lambda size: struct.pack("<IBI", 0xfd2fb528, 0xa0, size)
    if size is not None:
        return frame(size) + (size << 3 | 2 | 1).to_bytes(3, "little") + data[:1]
    return frame(len(data)) + (len(data) << 3 | 1).to_bytes(3, "little") + data


def chunk(kind, payload, packed=None, raw=None, flags=0):
    packed = zstd(payload) if packed is None else packed
    return struct.pack("<QQHHII", 0, 0, kind, flags, len(payload) if raw is None else raw, len(packed)) + packed


def recording(*parts, program=b"palpated", version=2):
    header = b"\x89PLPREC\n" + struct.pack("<IIq", version, len(program), 1) + program + bytes(8)
    return b"\0" + header + b"".join(parts)


def files():
    known = {name: chunk(*value) for name, value in chunks().items()}
    here = [fields(n, (0.1 * n, 0.0, 1.0)) for n in range(4)]
    ticks = chunk(SAMPLES, samples(here))
    far = fields(4, (1.0, 1.0, 1.0))
    far[26] = (8, 3000)  # missed ticks
    end = lambda count, lost=0: chunk(END, struct.pack("<2Q", count, lost))
    whole = (chunk(SCENE, scene()), chunk(KEYFRAME, struct.pack("<Q", 0) + text(keyframe())), ticks)
    return {
        "whole": recording(*whole, end(4)),
        "open": recording(*whole),
        "with_a_gap": recording(*whole, chunk(GAP, struct.pack("<2Q", 4, 9)), end(4, 6)),
        "missed_ticks": recording(*whole, chunk(SAMPLES, samples([far])), end(5)),
        "counts_that_do_not_fit": recording(*whole, end(5)),
        "more_behind_the_end": recording(*whole, end(4), ticks),
        "ticks_again": recording(*whole, ticks),
        "markers": recording(known["marker"], known["marker_long"]),
        "edit": recording(chunk(EDIT, edit((0,), planes=b""))),
        "no_chunks": recording(),
        "no_program": recording(program=b""),
        "program_too_long": recording(program=b"p" * 300),
        "version_1": recording(version=1),
        "checksums_wrong": b"\1" + recording(*whole)[1:],
        "other_raw_size": recording(chunk(MARKER, known["marker"], raw=4)),
        "raw_size_beyond_the_limit": recording(chunk(MARKER, b"", raw=(16 << 20) + 1)),
        "bomb": recording(chunk(KEYFRAME, b"", packed=zstd(b"\0", 1 << 17), raw=1 << 17)),
        "bomb_with_another_size": recording(chunk(KEYFRAME, b"", packed=zstd(b"\0", 1 << 17), raw=100)),
        "flags": recording(chunk(GAP, struct.pack("<2Q", 4, 9), flags=1)),
        "gap_of_everything": recording(known["gap_of_everything"], end(0, 0)),
        "cut": recording(*whole)[:-5],
        "no_recording": b"\0PNG and so on, long enough for a header",
    }


def step(kind, data=b""):
    return bytes([kind]) + data


def sized(kind, payload):
    return step(kind, struct.pack("<H", len(payload)) + payload)


def ticks(count, hip, flags=0):
    return step(2, struct.pack("<BH3f", count - 1, flags, *hip))


def edit_step(brick, *pattern):
    return step(3, struct.pack("<B4f", brick, *pattern))


def attacks():
    """States that no servo has."""
    box = lambda **other: place(**({"kind": 1, "vertices": (), "weights": ()} | other))
    return {
        "weight_below_0": place(weights=(-1.0,)),
        "weights_all_0": place(weights=(0.0,), count=1),
        "weight_not_a_number": place(weights=(NAN,)),
        "weight_infinite": place(weights=(INFINITY,)),
        "weights_too_great": place(vertices=(0, 1), weights=(1e300, 1e300), faces=0x05),
        "no_vertices": place(vertices=(), weights=()),
        "five_vertices": place(count=5),
        "vertex_of_another_face": place(vertices=(6,)),
        "vertex_not_of_the_cell": place(vertices=(15,), faces=0),
        "vertex_16": place(vertices=(16,)),
        "vertices_apart": place(vertices=(0, 6), weights=(0.5, 0.5), faces=0),
        "vertex_twice": place(vertices=(0, 0), weights=(0.5, 0.5)),
        "faces_of_another_vertex": place(faces=0x2a),
        "all_faces": place(faces=0x3f),
        "no_faces": place(faces=0),
        "tetrahedron_29": place(vertices=(14, 13, 0, 1), weights=(0.25,) * 4, faces=0, tetrahedron=29),
        "tetrahedron_of_others": place(vertices=(14, 13, 0, 1), weights=(0.25,) * 4, faces=0, tetrahedron=0),
        "tetrahedron_30": place(tetrahedron=30),
        "cell_outside": place(cell=(-1, 40, 4)),
        "cell_far_away": place(cell=(1 << 30, -(1 << 30), 4)),
        "cell_beyond": place(cell=(2**31 - 1, -2**31, 4)),
        "box_elsewhere": box(p_I=(40, -7, 4)),
        "box_not_a_number": box(p_I=(NAN, INFINITY, 4)),
        "box_faces": box(faces=0x3f),
        "outside_not_a_number": box(kind=0, p_I=(NAN, 1e308, -INFINITY), faces=0),
        "outside_in_the_middle": box(kind=0, faces=0),
        "no_kind": place(kind=3),
    }


def replays():
    states = {name: keyframe(where=where) for name, where in attacks().items()}
    states |= {
        "proxy_not_a_number": keyframe(p_DH=(NAN, 0, 0)),
        "proxy_far_away": keyframe(p_DH=(1e308, -1e308, 0), geometry=9),
        "normal_not_a_number": keyframe(normal=(NAN, NAN, NAN)),
        "normal_huge": keyframe(normal=(0, 0, -1e308)),
        "hip_not_a_number": keyframe(hip=(NAN, 0, 0)),
        "last_hip_infinite": keyframe(last=(INFINITY, 0, 0), isovalue=0.4),
        "velocity_not_a_number": keyframe(velocity=(NAN, 0, 0)),
        "no_hip": keyframe(has_hip=0),
        "buried": keyframe(buried=1),
        "box_on_surface": keyframe(where=attacks()["box_elsewhere"]),
        "positions_beyond": keyframe(positions=11, newest=10),
        "times_not_a_number": keyframe(positions=10, times=(NAN,) * 10),
        "other_volume": keyframe(volume=2**64 - 1),
        "other_geometry": keyframe(geometry=7),
        "layout": keyframe(layout=3),
        "cut": keyframe()[:-1],
    }
    begin = sized(0, scene())
    press = ticks(2, (0, 0, 0)) + ticks(4, (0, 0, 6.0)) + ticks(3, (9, -4, -8))
    results = {f"state_{name}": begin + sized(1, state) + press for name, state in states.items()}
    begun = begin + sized(1, keyframe(placed=0, on_surface=0, where=place(kind=0))) + ticks(4, (0, 0, -15))
    odd = {
        "good": scene(), "above": scene(words=settings(free_side="above")), "bcc": scene(method="bcc"),
        "no_method": scene(method="tptd"),
        "isovalue_not_a_number": scene(isovalue=NAN), "isovalue_infinite": scene(isovalue=INFINITY),
        "isovalue_far": scene(isovalue=-1e300), "place_flat": scene(linear=(3, 0, 0, 0, 3, 0, 0, 0, 0)),
        "place_huge": scene(linear=(1e200, 0, 0, 0, 1e200, 0, 0, 0, 1e200)),
        "place_far_too_large": scene(linear=(1e140, 0, 0, 0, 1e140, 0, 0, 0, 1e140)),
        "place_tiny": scene(linear=(1e-200, 0, 0, 0, 1e-200, 0, 0, 0, 1e-200)),
        "place_uneven": scene(linear=(1e9, 0, 0, 0, 1e-9, 0, 0, 0, 3)),
        "place_mirrored": scene(linear=(-3, 0, 0, 1, 3, 0, 0, 0, 3)),
        "place_far": scene(translation=(1e300, 0, 0)), "place_not_a_number": scene(translation=(NAN, 0, 0)),
        "stiffness_not_a_number": scene(words=settings(stiffness_n_per_mm="nan")),
        "stiffness_infinite": scene(words=settings(stiffness_n_per_mm="inf")),
        "stiffness_0": scene(words=settings(stiffness_n_per_mm="0")),
        "stiffness_tiny": scene(words=settings(stiffness_n_per_mm="1e-300")),
        "friction_infinite": scene(words=settings(static_friction="inf", dynamic_friction="inf")),
        "friction_below_0": scene(words=settings(static_friction="1", dynamic_friction="-1e9")),
        "pops": scene(words=settings(pop_force_n="0.001")),
        "magnet_infinite": scene(words=settings(magnet_force_n="inf", magnet_range_mm="inf")),
        "limits_not_a_number": scene(limits=(NAN,) * 7), "limits_of_0": scene(limits=(0,) * 7),
        "hardware": scene(limits=(3.3, 200, 0.5, 1.0, 10, 2000, 20)), "forces_off": scene(forces_off=1),
        "other_rate": scene(period=0.002), "unknown_setting": scene(words=settings(a_new_one="1")),
    }
    results |= {f"scene_{name}": sized(0, data) + begun[len(begin):] + press for name, data in odd.items()}
    results |= {
        "edits": begun + press + edit_step(0, 1, 8, 0, 3) + edit_step(7, 0, 0, 0, 9) +
                 sized(0, scene(volume=2, revision=1)) + press,
        "edit_huge": begun + press + edit_step(0, 3e38, -3e38, 1e38, 0) + sized(0, scene(volume=2)) + press,
        "edit_not_a_number": begun + edit_step(0, NAN, 0, 0, 0) + sized(0, scene(volume=2)) + press,
        "edit_outside": begun + edit_step(8, 0, 0, 0, 0) + sized(0, scene(volume=2)) + press,
        "edits_missing": begun + edit_step(0, 1, 8, 0, 3) + sized(0, scene(volume=2, missing=1)) + press,
        "hash_of_another": sized(128 + 4, scene()) + begun + press,
        "isovalue_moves": begun + press + sized(0, scene(isovalue=0.3, settings_revision=2)) + press +
                          sized(0, scene(isovalue=0.9, settings_revision=3)) + press,
        "sides_change": begun + press + sized(0, scene(words=settings(free_side="above"))) + press,
        "place_moves": begun + press + sized(0, scene(geometry=2, translation=(0, 0, 0))) + press,
        "device_faults": begun + ticks(5, (0, 0, 0), 1) + ticks(5, (0, 0, 0), 2 << 7) + ticks(5, (0, 0, 0), 3 << 5) +
                         ticks(9, (NAN, 0, 0)) + ticks(9, (1e9, 0, 0)) + ticks(9, (3, 3, 3), 0xfe00),
        "suspended": begun + press + ticks(5, (0, 0, 0), 2) + ticks(5, (0, 0, 0), 4) + press,
        "samples": begun + sized(4, samples([fields(0, (0.0, 0.0, 0.0)), fields(1, (1.0, 0.0, 3.0))])),
        "gap": begun + press + step(5, struct.pack("<2Q", 3, 9)) + press + sized(1, keyframe()) + press,
        "nothing_before_a_scene": sized(1, keyframe()) + press + begun,
    }
    return results


def texts():
    """Settings of a scene."""
    return {
        "all": settings(carve_radius_mm="2", carve_rate_per_s="-20", viscosity_n_s_per_m="1", carve_tool="off",
                        clutch_tool="on"),
        "empty": "", "no_line_end": "stiffness_n_per_mm=1", "no_equals": "stiffness\n", "twice": "pop_force_n=1\n" * 2,
        "unknown": "tomorrow=yes\n", "no_number": "pop_force_n=1,5\n", "no_flag": "carve_tool=yes\n",
        "no_side": "free_side=left\n", "infinite": "pop_force_n=-inf\n", "not_a_number": "pop_force_n=nan(123)\n",
        "denormal": "pop_force_n=4.9e-324\n", "overflow": "pop_force_n=1e999\n", "hex": "pop_force_n=0x1p3\n",
        "zero_bytes": "\0=\0\n", "equals": "====\n\n",
    }


def corpora():
    for name, (kind, payload) in chunks().items():
        yield "recording_chunk_fuzz", name, struct.pack("<H", kind) + payload
    for name, words in texts().items():
        yield "recording_chunk_fuzz", f"settings_{name}", struct.pack("<H", SCENE) + scene(words=words)
    for name, data in files().items():
        yield "recording_file_fuzz", name, data
    for name, data in replays().items():
        yield "recording_replay_fuzz", name, data
