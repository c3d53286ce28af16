"""Recordings, their messages and states of the servo, from palpate/v1/recorded.proto, the
specification of MCAP and server/servo; checksums are left out, which is allowed."""

import struct

NAN, INFINITY = float("nan"), float("inf")
HERE = (-16.5, -13.5, -12.0)  # of voxel (0, 0, 0) in D
SETTINGS = {"isovalue": 1, "normalized_isovalue": 2, "stiffness_n_per_mm": 3, "damping_n_s_per_m": 4, "method": 5,
            "static_friction": 6, "dynamic_friction": 7, "viscosity_n_s_per_m": 8, "pop_force_n": 9,
            "magnet_force_n": 10, "magnet_range_mm": 11, "force_shading": 12, "passivity_control": 13, "free_side": 14}


def varint(number):
    number %= 1 << 64
    out = b""
    while number > 0x7f:
        out, number = out + bytes([number & 0x7f | 0x80]), number >> 7
    return out + bytes([number])


def fixed(number):
    return struct.pack("<Q", number)


def message(fields):
    """fields: by number: a whole number, a float, bytes of a text or message, or ("fixed", number)."""
    out = b""
    for number, value in fields.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, float):
                out += varint(number << 3 | 1) + struct.pack("<d", one)
            elif isinstance(one, int):
                out += varint(number << 3) + varint(one)
            elif isinstance(one, tuple):
                out += varint(number << 3 | 1) + fixed(one[1])
            else:
                data = one.encode() if isinstance(one, str) else one
                out += varint(number << 3 | 2) + varint(len(data)) + data
    return out


def vector(v):
    return message({n + 1: float(x) for n, x in enumerate(v)})


def settings(**changes):
    values = {"stiffness_n_per_mm": 0.5, "damping_n_s_per_m": 0.0, "static_friction": 0.6,
              "dynamic_friction": 0.4, "pop_force_n": 0.0, "magnet_force_n": 0.5,
              "magnet_range_mm": 2.0, "force_shading": 1, "passivity_control": 1, "free_side": 1, "method": 2}
    values.update(changes)
    return {SETTINGS.get(key, key): value for key, value in values.items()}


def affine(linear, translation):
    return message({1: struct.pack("<9d", *linear), 2: vector(translation)})


def scene(tick=0, revision=1, settings_revision=1, volume=1, loaded=1, geometry=1, isovalue=0.5,
          words=None, linear=(3, 0, 0, 0, 3, 0, 0, 0, 3), translation=HERE, missing=0,
          period=0.001, limits=(3.3, 200, 0, 0, 0, 0, 0), forces_off=0, size=(12, 10, 9), more=None):
    words = {1: float(isovalue), 2: float(isovalue), **(settings() if words is None else words)}
    safety = {n + 1: float(limit) for n, limit in enumerate(limits)} | {9: 1}
    x, y, z = size
    return message({
        1: tick, 2: revision, 3: settings_revision, 4: volume, 5: loaded, 6: geometry, 7: message(words),
        8: affine(linear, translation), 10: "builtin:small", 11: 1, 13: missing, 14: ("fixed", 1), 15: ("fixed", 2),
        16: x, 17: y, 18: z, 19: vector((1, 1, 1)), 20: 0.0, 21: 1.0, 23: float(period), 24: forces_off,
        25: message(safety), **(more or {})})


def held_tool(radii=(2.0, 1.0), apart_mm=3.0, length_mm=30.0):
    balls = [message({1: vector((0, 0, n * apart_mm)), 2: float(radius), 3: n == 0}) for n, radius in enumerate(radii)]
    return message({1: "drill", 2: balls, 3: length_mm})


def felt_tool(fields=(2.0, 1.0), **changes):
    fields = [message({1: radius, 2: affine((3, 0, 0, 0, 3, 0, 0, 0, 3), HERE)}) for radius in fields]
    return {29: message({1: held_tool(**changes), 2: fields})}


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


def sample(tick, hip=(0.0, 0.0, 0.0), mode=1, scene_revision=1, missed=0, **changes):
    pose = {1: tick, 2: 1000 * tick, 3: vector(hip), 4: vector(hip), 8: message({1: 1.0, 2: 0.0, 3: 0.0, 4: 0.0}),
            9: 0, 10: vector((0, 0, 0.5)), 11: mode, 12: 0, 13: 0.5, 14: 0.5, 15: 1, 16: 1, 17: 17000, 18: missed, 19: 3,
            20: 0, 21: 1, 22: message({1: 3, 2: 1, 3: 3.3})}
    pose.update(changes.pop("pose", {}))
    return message({1: message(pose), 2: 1, 3: 1, 4: 0, 5: 1, 6: 0, 7: scene_revision, 8: 0})


def zstd(data, size=None):
    """A frame of one block that is not compressed; or of one byte again and again."""
    frame = lambda size: struct.pack("<IBI", 0xfd2fb528, 0xa0, size)
    if size is not None:
        return frame(size) + (size << 3 | 2 | 1).to_bytes(3, "little") + data[:1]
    return frame(len(data)) + (len(data) << 3 | 1).to_bytes(3, "little") + data


def edit(numbers=(0, 5), base=1, revision=2, tick=3, values=None, tiles=(), known=()):
    values = zstd(bytes(4 * 512 * len(numbers))) if values is None else values
    packed = b"".join(map(varint, numbers))
    tile = lambda first, count, value: varint(8) + varint(first) + varint(16) + varint(count) + b"\x1d" + struct.pack("<f", value)
    bricks = {1: packed, 2: values, 4: 4, 5: [tile(*one) for one in tiles]}
    runs = [message({1: first, 2: count}) for first, count in known]
    return message({1: tick, 2: base, 3: revision, 5: runs} | ({} if known else {4: message(bricks)}))


def event(words, tick=3, time_ns=99):
    return message({1: tick, 2: time_ns, 3: words})


def messages():
    """(topic, message) by name: a message of a recording that begins at tick 3."""
    return {
        "tick": ("/tick", sample(3)),
        "tick_no_mode": ("/tick", sample(3, mode=0)),
        "tick_unknown_mode": ("/tick", sample(3, mode=300)),
        "tick_empty": ("/tick", b""),
        "tick_cut": ("/tick", sample(3)[:-1]),
        "tick_twice_the_pose": ("/tick", sample(3) + sample(3)),
        "tick_end_group": ("/tick", b"\x0c" + sample(3)),
        "tick_field_0": ("/tick", b"\x00\x00" + sample(3)),
        "tick_long_tag": ("/tick", b"\x90\x80\x80\x80\x80\x80\x00\x01" + sample(3)),
        "scene": ("/scene", scene(3)),
        "scene_unknown_setting": ("/scene", scene(3, words=settings() | {1000: 7})),
        "scene_not_a_number": ("/scene", scene(3, words=settings(pop_force_n=NAN))),
        "scene_of_no_method": ("/scene", scene(3, words=settings(method=9))),
        "scene_without_a_place": ("/scene", message({1: 3})),
        "voxels": ("/voxels", edit()),
        "voxels_out_of_order": ("/voxels", edit((5, 0))),
        "voxels_cut": ("/voxels", edit((0,))[:-1]),
        "voxels_of_another_size": ("/voxels", edit((0,), values=zstd(bytes(99)))),
        "voxels_bomb": ("/voxels", edit((0,), values=zstd(b"\0", 1 << 17))),
        "voxels_far": ("/voxels", edit((1 << 63,))),
        "voxels_tiles": ("/voxels", edit((), values=b"", tiles=[(0, 2, 0.5), (3, 1, NAN)])),
        "voxels_tiles_many": ("/voxels", edit((), values=b"", tiles=[(0, 1 << 62, 0.5)])),
        "voxels_known": ("/voxels", edit(known=[(0, 8)])),
        "voxels_known_many": ("/voxels", edit(known=[(0, 1 << 63)])),
        "event": ("/event", event("here, \"now\"\n")),
        "event_long": ("/event", event("x" * 4000)),
        "event_too_long": ("/event", event("x" * 5000)),
        "event_no_text": ("/event", event(b"\xff\xfe")),
        "keyframe": ("/keyframe", message({1: 3, 2: keyframe()})),
        "clock": ("/clock", message({1: 5, 2: 6})),
        "of_others": ("/camera", b"\xff\xff"),
    }


TOPICS = ("/tick", "/scene", "/voxels", "/keyframe", "/event", "/clock", "/camera")  # channels 0, 1, ...


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def texts(**pairs):
    data = b"".join(text(key) + text(value) for key, value in pairs.items())
    return struct.pack("<I", len(data)) + data


def text(words):
    data = words.encode() if isinstance(words, str) else words
    return struct.pack("<I", len(data)) + data


def record_of(topic, data, time_ns=1):
    return record(5, struct.pack("<HIQQ", TOPICS.index(topic), 0, time_ns, time_ns) + data)


def chunk(*records, packing="", packed=None, size=None):
    data = b"".join(records)
    packed = data if packed is None else packed
    return record(6, struct.pack("<QQQI", 1, 1, len(data) if size is None else size, 0) + text(packing) +
                  struct.pack("<Q", len(packed)) + packed)


def recording(*parts, created="1", topics=TOPICS, schema="palpate.v1.Recorded"):
    """A recording that is not closed."""
    return (b"\x89MCAP0\r\n" + record(1, text("") + text("Palpate: palpated 0")) +
            b"".join(record(3, struct.pack("<H", n + 1) + text(schema + topic[1:].capitalize()) + text("protobuf") +
                            text("")) +
                     record(4, struct.pack("<HH", n, n + 1) + text(topic) + text("protobuf") + texts())
                     for n, topic in enumerate(topics)) +
            record(12, text("palpate.recording") + texts(created_unix_ns=created, program="palpated 0")) +
            b"".join(parts))


def end(ticks, lost=0):
    return (record(12, text("palpate.end") + texts(ticks=str(ticks), lost_ticks=str(lost))) +
            record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n")


def files():
    tick = lambda n, **changes: record_of("/tick", sample(n, (0.1 * n, 0.0, 1.0), **changes))
    four = [tick(n) for n in range(4)]
    whole = chunk(record_of("/scene", scene()), record_of("/keyframe", message({2: keyframe()})), *four)
    bomb = zstd(b"\0", 1 << 17)
    return {
        "whole": recording(whole, end(4)),
        "open": recording(whole),
        "packed": recording(chunk(*four, packing="zstd", packed=zstd(b"".join(four))), end(4)),
        "in_no_chunk": recording(*four, end(4)),
        "with_a_gap": recording(whole, chunk(tick(10)), end(5, 6)),
        "lost_at_the_end": recording(whole, end(4, 7)),
        "lost_everything": recording(whole, end(4, 2**64 - 1)),
        "missed_ticks": recording(whole, chunk(tick(4, missed=3000)), end(5)),
        "counts_that_do_not_fit": recording(whole, end(5)),
        "counts_that_are_none": recording(whole, end("four")),
        "more_behind_the_end": recording(whole, end(4), whole),
        "ticks_again": recording(whole, whole),
        "every_message": recording(*(chunk(record_of(*one)) for one in messages().values())),
        "no_chunks": recording(),
        "no_time": recording(created=""),
        "checksums_wrong": recording(record(6, struct.pack("<QQQI", 1, 1, 5, 7) + text("") + fixed(5) + b"abcde")),
        "size_beyond_the_limit": recording(chunk(size=(16 << 20) + 1)),
        "bomb": recording(chunk(packing="zstd", packed=bomb, size=1 << 17)),
        "bomb_with_another_size": recording(chunk(packing="zstd", packed=bomb, size=100)),
        "lz4": recording(chunk(packing="lz4", packed=b"abc", size=100)),
        "chunk_in_a_chunk": recording(chunk(whole)),
        "no_channel": recording(chunk(*four), topics=()),
        "another_schema": recording(whole, end(4), schema="foxglove.Pose"),
        "cut": recording(whole)[:-5],
        "no_recording": b"PNG and so on, long enough for a header",
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
    of = lambda **changes: scene(words=settings(**changes))
    odd = {
        "good": scene(), "above": of(free_side=2), "bcc": of(method=1), "no_method": of(method=3),
        "isovalue_not_a_number": scene(isovalue=NAN), "isovalue_infinite": scene(isovalue=INFINITY),
        "isovalue_far": scene(isovalue=-1e300), "place_flat": scene(linear=(3, 0, 0, 0, 3, 0, 0, 0, 0)),
        "place_huge": scene(linear=(1e200, 0, 0, 0, 1e200, 0, 0, 0, 1e200)),
        "place_far_too_large": scene(linear=(1e140, 0, 0, 0, 1e140, 0, 0, 0, 1e140)),
        "place_tiny": scene(linear=(1e-200, 0, 0, 0, 1e-200, 0, 0, 0, 1e-200)),
        "place_uneven": scene(linear=(1e9, 0, 0, 0, 1e-9, 0, 0, 0, 3)),
        "place_mirrored": scene(linear=(-3, 0, 0, 1, 3, 0, 0, 0, 3)),
        "place_far": scene(translation=(1e300, 0, 0)), "place_not_a_number": scene(translation=(NAN, 0, 0)),
        "stiffness_not_a_number": of(stiffness_n_per_mm=NAN), "stiffness_infinite": of(stiffness_n_per_mm=INFINITY),
        "stiffness_0": of(stiffness_n_per_mm=0.0), "stiffness_tiny": of(stiffness_n_per_mm=1e-300),
        "friction_infinite": of(static_friction=INFINITY, dynamic_friction=INFINITY),
        "friction_below_0": of(static_friction=1.0, dynamic_friction=-1e9), "pops": of(pop_force_n=0.001),
        "magnet_infinite": of(magnet_force_n=INFINITY, magnet_range_mm=INFINITY),
        "limits_not_a_number": scene(limits=(NAN,) * 7), "limits_of_0": scene(limits=(0,) * 7),
        "hardware": scene(limits=(3.3, 200, 0.5, 1.0, 10, 2000, 20)), "forces_off": scene(forces_off=1),
        "other_rate": scene(period=0.002), "unknown_setting": scene(words=settings() | {1000: 7}),
        "tool": scene(more=felt_tool()), "tool_of_points": scene(more=felt_tool((), radii=(0.0,) * 64)),
        "tool_far": scene(more=felt_tool(apart_mm=-240.0)), "tool_too_far": scene(more=felt_tool(apart_mm=1e9)),
        "tool_not_a_number": scene(more=felt_tool((NAN,), radii=(NAN,), apart_mm=NAN)),
        "tool_of_no_length": scene(more=felt_tool(length_mm=-1.0)), "tool_without_fields": scene(more=felt_tool(())),
        "tool_of_many": scene(more=felt_tool((), radii=(0.0,) * 65)),
        "tool_awaited": scene(words=settings() | {24: held_tool()}),
        "device_of_0": scene(more={26: message({1: 0.0, 2: 3.3, 3: 0.001})}),
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
        "sides_change": begun + press + sized(0, scene(words=settings(free_side=2))) + press,
        "place_moves": begun + press + sized(0, scene(geometry=2, translation=(0, 0, 0))) + press,
        "device_faults": begun + ticks(5, (0, 0, 0), 1) + ticks(5, (0, 0, 0), 2 << 7) + ticks(5, (0, 0, 0), 3 << 5) +
                         ticks(9, (NAN, 0, 0)) + ticks(9, (1e9, 0, 0)) + ticks(9, (3, 3, 3), 0xfe00),
        "suspended": begun + press + ticks(5, (0, 0, 0), 2) + ticks(5, (0, 0, 0), 4) + press,
        "samples": begun + sized(4, sample(0)) + sized(4, sample(1, (1.0, 0.0, 3.0))),
        "tool_taken": begun + press + sized(0, scene(more=felt_tool())) + press + edit_step(0, 1, 8, 0, 3) +
                      sized(0, scene(volume=2, more=felt_tool())) + press +
                      sized(0, scene(isovalue=0.3, settings_revision=2, more=felt_tool((), radii=(0.0,)))) + press +
                      sized(0, scene()) + press,
        "gap": begun + press + step(5, struct.pack("<2Q", 3, 9)) + press + sized(1, keyframe()) + press,
        "nothing_before_a_scene": sized(1, keyframe()) + press + begun,
    }
    return results


def corpora():
    for name, data in files().items():
        yield "recording_file_fuzz", name, data
    for name, one in messages().items():
        yield "recording_file_fuzz", f"message_{name}", recording(chunk(record_of(*one)))
    for name, data in replays().items():
        yield "recording_replay_fuzz", name, data
