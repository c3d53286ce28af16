"""Image files in the formats that palpate-import reads: 2 to 4 voxels along an axis."""

import gzip
import struct
import zlib

SHORTS = struct.pack("<24h", *(k * k - 90 for k in range(24)))  # 4 x 3 x 2
BYTES = bytes(range(0, 240, 10))


def deflated(data):
    return gzip.compress(data, 9, mtime=0)


def nrrd(fields, data=SHORTS, version=4, line="\n"):
    head = [f"NRRD000{version}", *(f"{name}: {value}" for name, value in fields.items()), "", ""]
    return line.join(head).encode("latin-1") + data


def nrrd_fields(**other):
    fields = {"type": "int16", "dimension": "3", "sizes": "4 3 2", "encoding": "raw",
              "endian": "little"}
    fields.update({name.replace("_", " "): value for name, value in other.items()})
    return {name: value for name, value in fields.items() if value is not None}


def nrrds():
    directions = {"space": "left-posterior-superior", "space directions": "(0.5,0,0) (0,0.5,0) (0,0,2)",
                  "space origin": "(-3,4,1e2)"}
    series = nrrd_fields(dimension="4", sizes="2 2 2 3", kinds="domain domain domain time")
    return {
        "plain": nrrd(nrrd_fields(spacings="0.5 0.5 2")),
        "lps": nrrd(nrrd_fields() | directions),
        "ras": nrrd(nrrd_fields() | directions | {"space": "RAS"}),
        "las_with_time": nrrd(series | directions | {
            "space": "left-anterior-superior-time",
            "space directions": "(1,0,0,0) (0,1,0,0) (0,0,1,0) none", "space origin": "(0,0,0,5)"}),
        "series": nrrd(series),
        "gzip": nrrd(nrrd_fields(encoding="gzip"), deflated(SHORTS)),
        "gzip_two_members": nrrd(nrrd_fields(encoding="gz"), deflated(SHORTS[:7]) + deflated(SHORTS[7:])),
        "gzip_cut": nrrd(nrrd_fields(encoding="gzip"), deflated(SHORTS)[:-12]),
        "gzip_bomb": nrrd(nrrd_fields(encoding="gzip"), deflated(bytes(1 << 17))),
        "zlib": nrrd(nrrd_fields(encoding="gzip"), zlib.compress(SHORTS)),
        "big_endian_double": nrrd(nrrd_fields(type="double", endian="big"), struct.pack(">24d", *range(24))),
        "uint8_no_endian": nrrd(nrrd_fields(type="uchar", endian=None), BYTES),
        "axis_mins": nrrd(nrrd_fields(**{"axis_mins": "0 0 nan", "axis_maxs": "4 3 nan",
                                         "centers": "cell node cell"})),
        "old_with_comments": nrrd({"# a remark": "x"} | nrrd_fields(), version=1, line="\r\n"),
        "key_and_value": nrrd({"a key:": "= a value"} | nrrd_fields()),
        "detached": nrrd(nrrd_fields(**{"data_file": "voxels.raw"}), b""),
        "detached_above": nrrd(nrrd_fields(**{"data_file": "../voxels.raw"}), b""),
        "byte_skip": nrrd(nrrd_fields(**{"byte_skip": "8"}), b"skipped " + SHORTS),
        "byte_skip_to_end": nrrd(nrrd_fields(**{"byte_skip": "-1"}), b"any bytes" + SHORTS),
        "truncated": nrrd(nrrd_fields(), SHORTS[:-1]),
        "size_that_overflows": nrrd(nrrd_fields(sizes="4611686018427387904 4 2")),
        "frames_that_overflow": nrrd(series | {"sizes": "2 2 2 2147483647"}),
        "direction_that_overflows": nrrd(nrrd_fields() | directions | {
            "space directions": "(1e200,1e200,0) (0,1,0) (0,0,1e-200)"}),
        "units": nrrd(nrrd_fields(**{"sample_units": '"HU"'})),
        "field_twice": nrrd(nrrd_fields(), b"").replace(b"\n\n", b"\ntype: int8\n\n"),
        "no_end": nrrd(nrrd_fields(), b"").rstrip(b"\n"),
    }


def meta_image(data=SHORTS, **other):
    fields = {"ObjectType": "Image", "NDims": "3", "BinaryData": "True", "DimSize": "4 3 2",
              "ElementType": "MET_SHORT", "ElementSpacing": "0.5 0.5 2", "Offset": "-3 4 100",
              "TransformMatrix": "1 0 0 0 1 0 0 0 1", "ElementDataFile": "LOCAL"}
    fields.update(other)
    fields["ElementDataFile"] = fields.pop("ElementDataFile")  # the last one
    lines = [f"{name} = {value}\n" for name, value in fields.items() if value is not None]
    return "".join(lines).encode() + data


def meta_images():
    packed = zlib.compress(SHORTS)
    return {
        "plain": meta_image(),
        "compressed": meta_image(packed, CompressedData="True", CompressedDataSize=len(packed)),
        "compressed_cut": meta_image(packed[:-5], CompressedData="True", CompressedDataSize=len(packed)),
        "detached": meta_image(b"", ElementDataFile="voxels.raw"),
        "detached_with_header": meta_image(b"", ElementDataFile="voxels.raw", HeaderSize="-1"),
        "detached_above": meta_image(b"", ElementDataFile="a/../../voxels.raw"),
        "list": meta_image(b"a\nb\n", ElementDataFile="LIST"),
        "pattern": meta_image(b"", ElementDataFile="a%03d.raw 1 2 1"),
        "two_channels": meta_image(ElementNumberOfChannels="2"),
        "as_text": meta_image(b"1 2 3", BinaryData="False"),
        "double": meta_image(struct.pack("<24d", *range(24)), ElementType="MET_DOUBLE"),
        "colons": meta_image().replace(b" = ", b":"),
        "carriage_returns": meta_image(b"").replace(b"\n", b"\r\n") + SHORTS,
        "four_axes": meta_image(NDims="4", DimSize="4 3 2 1", ElementSpacing="1 1 1 1", Offset="0 0 0 0",
                                TransformMatrix=None),
        "truncated": meta_image(SHORTS[:-1]),
        "header_size_that_overflows": meta_image(b"", ElementDataFile="voxels.raw",
                                                 HeaderSize="9223372036854775807"),
    }


def nifti1(data=SHORTS, dim=(3, 4, 3, 2, 1, 1, 1, 1),
           pixdim=(1, 0.5, 0.5, 2, 0, 0, 0, 0), offset=352.0, slope=(0.0, 0.0), units=2, codes=(0, 0),
           quaternion=(0,) * 6, srow=(0,) * 12, order="<"):
    head = bytearray(352)
    struct.pack_into(order + "i", head, 0, 348)
    struct.pack_into(order + "8h", head, 40, *dim)
    struct.pack_into(order + "2h", head, 70, 4, 16)
    struct.pack_into(order + "8f", head, 76, *pixdim)
    struct.pack_into(order + "3f", head, 108, offset, *slope)
    head[123] = units
    struct.pack_into(order + "2h", head, 252, *codes)
    struct.pack_into(order + "6f", head, 256, *quaternion)
    struct.pack_into(order + "12f", head, 280, *srow)
    head[344:348] = b"n+1\0"
    return bytes(head) + data


def nifti2(data=SHORTS, dim=(3, 4, 3, 2, 1, 1, 1, 1), pixdim=(1, 0.5, 0.5, 2, 0, 0, 0, 0), offset=544,
           units=2, codes=(1, 0), quaternion=(0,) * 6):
    head = bytearray(544)
    struct.pack_into("<i8s2h8q", head, 0, 540, b"n+2\0\r\n\x1a\n", 4, 16, *dim)
    struct.pack_into("<8dq2d", head, 104, *pixdim, offset, 1.0, 0.0)
    struct.pack_into("<2i6d", head, 344, *codes, *quaternion)
    struct.pack_into("<i", head, 500, units)
    return bytes(head) + data


def niftis():
    nan, infinity = float("nan"), float("inf")
    sform = (0.5, 0, 0, 1, 0, 0.5, 0, 2, 0, 0, 2, 3)
    return {
        "plain": nifti1(),
        "big_endian": nifti1(struct.pack(">24h", *range(24)), order=">"),
        "scaled": nifti1(slope=(0.5, -1000.0)),
        "qform": nifti1(codes=(1, 0), quaternion=(0.5, 0.5, 0.5, 1, 2, 3)),
        "qform_too_long": nifti1(codes=(1, 0), quaternion=(3, 4, 5, 1, 2, 3), pixdim=(-1, 1, 1, 1, 0, 0, 0, 0)),
        "sform": nifti1(codes=(0, 2), srow=sform),
        "sform_sheared": nifti1(codes=(1, 1), srow=(1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)),
        "series": nifti1(dim=(4, 2, 2, 2, 3, 1, 1, 1)),
        "metres": nifti1(units=1),
        "metres_that_overflow": nifti2(units=1, pixdim=(1, 1e307, 1, 1, 0, 0, 0, 0)),
        "origin_that_overflows": nifti2(units=1, quaternion=(0, 0, 0, 1e307, 1, 1)),
        "quaternion_that_overflows": nifti2(quaternion=(1e200, 1e200, 1e308, 0, 0, 0)),
        "deflated": deflated(nifti1()),
        "deflated_longer": deflated(nifti1() + bytes(500)),
        "deflated_cut": deflated(nifti1())[:-9],
        "deflated_bomb": deflated(nifti1() + bytes(1 << 17)),
        "deflated_checksum": deflated(nifti1())[:-8] + bytes(8),
        "nifti2": nifti2(),
        "nifti2_offset": nifti2(bytes(6) + SHORTS, offset=550),
        "offset_not_a_number": nifti1(offset=nan),
        "offset_infinite": nifti1(offset=infinity),
        "scale_infinite": nifti1(slope=(infinity, 0.0)),
        "huge": nifti2(dim=(3, 1 << 40, 1 << 40, 2, 1, 1, 1, 1)),
        "truncated": nifti1(SHORTS[:-1]),
    }


def tiff(pages, order="<", big=False):
    """pages: lists of (tag, type, values), and the data that STRIPS stands for."""
    code = {1: "B", 2: "B", 3: "H", 4: "I", 16: "Q"}
    start = 16 if big else 8
    word = "Q" if big else "I"
    head = (b"II" if order == "<" else b"MM") + struct.pack(
        order + ("HHHQ" if big else "HI"), *((43, 8, 0) if big else (42,)), 0)
    chain = start - (8 if big else 4)
    blob = bytearray(head)
    for tags, data in pages:
        at = len(blob)
        blob += data
        places = [at, len(data)]
        entries = b""
        extra = len(blob)
        tails = b""
        count_bytes, entry_bytes, word_bytes = (8, 20, 8) if big else (2, 12, 4)
        after = extra + count_bytes + entry_bytes * len(tags) + word_bytes
        for tag, kind, values in tags:
            values = [places[0] if v == "AT" else places[1] if v == "SIZE" else v for v in values]
            packed = struct.pack(order + f"{len(values)}{code[kind]}", *values)
            entries += struct.pack(order + "HH" + word, tag, kind, len(values))
            if len(packed) <= word_bytes:
                entries += packed.ljust(word_bytes, b"\0")
            else:
                entries += struct.pack(order + word, after + len(tails))
                tails += packed
        struct.pack_into(order + word, blob, chain, extra)
        blob += struct.pack(order + ("Q" if big else "H"), len(tags)) + entries
        chain = len(blob)
        blob += bytes(word_bytes) + tails
    return bytes(blob)


def page(width=4, height=3, bits=16, kind=1, compression=1, samples=1, photometric=1, rows=3,
         data=SHORTS[:24], **other):
    tags = {254: (4, [0]), 256: (3, [width]), 257: (3, [height]), 258: (3, [bits]), 259: (3, [compression]),
            262: (3, [photometric]), 273: (4, ["AT"]), 277: (3, [samples]), 278: (3, [rows]),
            279: (4, ["SIZE"]), 339: (3, [kind])}
    tags.update({int(tag[1:]): value for tag, value in other.items()})
    return [(tag, *value) for tag, value in sorted(tags.items()) if value], data


def tiffs():
    tile = {"t322": (3, [16]), "t323": (3, [16]), "t324": (4, ["AT"]), "t325": (4, ["SIZE"]), "t273": None,
            "t278": None, "t279": None}
    text = b"ImageJ=1.53\nchannels=2\n\0"
    one_page = b"ImageJ=1.53\nimages=2\nspacing=3\nunit=um\n\0"
    ome = (b"<OME><Image><Pixels SizeZ='2' PhysicalSizeX='1' PhysicalSizeY='2' PhysicalSizeZ='3'>"
           b"<TiffData FirstZ='1' IFD='0'/><TiffData IFD='1'/></Pixels></Image></OME>\0")
    return {
        "two_pages": tiff([page(), page()]),
        "big_endian": tiff([page(), page()], order=">"),
        "bigtiff": tiff([page(), page()], big=True),
        "bytes": tiff([page(bits=8, data=BYTES[:12])] * 2),
        "floats": tiff([page(bits=32, kind=3, data=struct.pack("<12f", *range(12)))] * 2),
        "doubles": tiff([page(bits=64, kind=3, data=struct.pack("<12d", *range(12)))] * 2),
        "two_strips": tiff([page(rows=2, t273=(4, ["AT", 8]), t279=(4, [16, 8]))] * 2),
        "tiles": tiff([page(bits=8, data=bytes(256), **tile)] * 2),
        "tiles_cut": tiff([page(bits=8, data=bytes(100), **tile)] * 2),
        "tile_of_gigabytes": tiff([page(bits=8, data=bytes(256), **(tile | {"t322": (4, [1 << 20]),
                                                                           "t323": (4, [1 << 20])}))] * 2),
        "lzw": tiff([page(compression=5, data=b"\x80\x00\x20\x50\x38\x24\x16\x0d\x07\x84\x42\x61\x50")] * 2),
        "deflate": tiff([page(compression=8, data=zlib.compress(SHORTS[:24]))] * 2),
        "packbits": tiff([page(compression=32773, data=b"\x17" + SHORTS[:24])] * 2),
        "predictor": tiff([page(compression=8, data=zlib.compress(SHORTS[:24]), t317=(3, [2]))] * 2),
        "jpeg": tiff([page(bits=8, compression=7, data=b"\xff\xd8\xff\xd9")] * 2),
        "fax": tiff([page(bits=8, compression=4, data=bytes(12))] * 2),
        "white_is_zero": tiff([page(photometric=0)] * 2),
        "thumbnail": tiff([page(), page(), page(width=2, height=1, rows=1, t254=(4, [1]))]),
        "channels": tiff([page(t270=(2, list(text)))] * 2),
        "one_page": tiff([page(t270=(2, list(one_page)), data=SHORTS[:48])]),
        "ome": tiff([page(t270=(2, list(ome)))] * 2),
        "data_behind_the_end": tiff([page(t273=(4, [100000]))] * 2),
        "size_beyond_the_end": tiff([page(t279=(4, [0xffffffff]))] * 2),
        "huge": tiff([page(t256=(4, [0x40000000]), t257=(4, [0x40000000]), t278=(4, [1]))] * 2),
        "no_rows": tiff([page(rows=0)] * 2),
        "loop": tiff([page(), page()])[:-4] + struct.pack("<I", 8),
    }


def dicom(elements, syntax=b"1.2.840.10008.1.2.1\0", preamble=128):
    meta = struct.pack("<HH2sH", 2, 0x10, b"UI", len(syntax)) + syntax
    return bytes(preamble) + b"DICM" + meta + elements


def element(group, number, vr, value, order="<", length=None):
    length = len(value) if length is None else length
    long = vr in (b"OB", b"OF", b"OW", b"SQ", b"UN", b"UT")
    return struct.pack(order + "HH", group, number) + vr + (
        struct.pack(order + "HI", 0, length) if long else struct.pack(order + "H", length)) + value


def implicit(group, number, value, length=None):
    return struct.pack("<HHI", group, number, len(value) if length is None else length) + value


def dicoms():
    u16 = lambda n, order="<": struct.pack(order + "H", n)
    shape = [(0x28, 2, b"US", 1), (0x28, 0x10, b"US", 3), (0x28, 0x11, b"US", 4), (0x28, 0x100, b"US", 16)]
    explicit = b"".join(element(g, e, vr, u16(n)) for g, e, vr, n in shape)
    pixels = element(0x7fe0, 0x10, b"OW", SHORTS[:24])
    place = (element(0x20, 0x32, b"DS", b"1\\2\\3 ") + element(0x20, 0x37, b"DS", b"1\\0\\0\\0\\1\\0 "))
    spaced = explicit + element(0x28, 0x30, b"DS", b"0,5\\0.5 ")
    table = (element(0x28, 0x3002, b"US", struct.pack("<3H", 2, 5, 16)) + element(0x28, 0x3004, b"LO", b"HU") +
             element(0x28, 0x3006, b"OW", SHORTS[:4]))
    item = lambda content, length=None: implicit(0xfffe, 0xe000, content, length)
    end_of_item, end = implicit(0xfffe, 0xe00d, b""), implicit(0xfffe, 0xe0dd, b"")
    sequence = lambda content: element(8, 0x1140, b"SQ", content, length=0xffffffff)
    nested = explicit[:8]
    for _ in range(20):
        nested = sequence(item(nested, 0xffffffff) + end_of_item + end)
    return {
        "explicit": dicom(explicit + pixels),
        "implicit": dicom(b"".join(implicit(g, e, u16(n)) for g, e, _, n in shape) +
                          implicit(0x7fe0, 0x10, SHORTS[:24]), b"1.2.840.10008.1.2\0"),
        "big_endian": dicom(b"".join(element(g, e, vr, u16(n, ">"), ">") for g, e, vr, n in shape) +
                            element(0x7fe0, 0x10, b"OW", SHORTS[:24], ">"), b"1.2.840.10008.1.2.2\0"),
        "deflated": dicom(zlib.compress(explicit), b"1.2.840.10008.1.2.1.99"),
        "slice": dicom(place + spaced + element(0x28, 0x1053, b"DS", b"2 ") + pixels),
        "table": dicom(place + spaced + element(0x28, 0x3000, b"SQ", implicit(0xfffe, 0xe000, table)) + pixels),
        "no_head": place + explicit + pixels + bytes(99),
        "no_head_but_meta": dicom(place + explicit + pixels + bytes(99))[132:],
        "syntax_unknown": dicom(explicit + pixels, b"1.2.840.10008.1.2.4.201\0"),
        "float_pixels": dicom(explicit + element(0x7fe0, 8, b"OF", bytes(48))),
        "sequence": dicom(element(8, 0x1140, b"SQ", item(b"")) + explicit + pixels),
        "sequence_without_length": dicom(sequence(item(explicit, 0xffffffff) + end_of_item + end) + explicit + pixels),
        "sequence_deep": dicom(nested + explicit + pixels),
        "sequence_unknown": dicom(element(9, 1, b"UN", item(b"ab") + end, length=0xffffffff) + explicit + pixels),
        "fragments": dicom(explicit + element(0x7fe0, 0x10, b"OB", item(b"") + item(b"abcd") + end, length=0xffffffff)),
        "fragments_cut": dicom(explicit + element(0x7fe0, 0x10, b"OB", item(b"abcd"), length=0xffffffff)),
        "frames": dicom(explicit + element(0x28, 8, b"IS", b"2 ") + pixels),
        "frames_that_overflow": dicom(explicit + element(0x28, 8, b"IS", b"9223372036854775807 ") + pixels),
        "frames_no_number": dicom(explicit + element(0x28, 8, b"IS", b"two ") + pixels),
        "few_pixels": dicom(explicit + element(0x7fe0, 0x10, b"OW", SHORTS[:22])),
        "no_pixels": dicom(element(0x10, 0x10, b"PN", b"Nobody^")),
        "no_size": dicom(pixels),
        "cut": dicom(explicit + pixels)[:-3],
        "padded": dicom(element(0x10, 0x10, b"PN", b"Nobody^") + bytes(20)),
        "length_beyond_the_end": dicom(element(8, 8, b"UT", b"", length=0xfffffffe)),
        "no_preamble": dicom(explicit, preamble=100),
    }


def raw_voxels():
    def described(size, offset, kind, big, data):
        return struct.pack("<4qBB", *size, offset, kind, big) + data
    return {
        "bytes": described((4, 3, 2), 0, 1, 0, BYTES),
        "shorts": described((4, 3, 2), 0, 2, 0, SHORTS),
        "big_shorts_with_offset": described((4, 3, 2), 5, 2, 1, bytes(5) + SHORTS),
        "doubles": described((2, 2, 2), 0, 7, 0, struct.pack("<8d", *range(8))),
        "doubles_that_overflow": described((2, 2, 2), 0, 7, 0, struct.pack("<8d", *[1e300, -1e300] * 4)),
        "no_numbers": described((2, 2, 2), 0, 6, 0, struct.pack("<8f", *[float("nan"), float("inf")] * 4)),
        "too_short": described((4, 3, 2), 0, 2, 0, SHORTS[:-1]),
        "offset_that_overflows": described((4, 3, 2), 2**63 - 1, 1, 0, BYTES),
        "size_that_overflows": described((2**62, 4, 2), 0, 1, 0, BYTES),
    }


def corpora():
    # In the order of image_fuzz.cpp.
    formats = (nrrds(), meta_images(), niftis(), tiffs(), dicoms(), raw_voxels())
    names = ("nrrd", "meta", "nifti", "tiff", "dicom", "raw")
    for number, (prefix, files) in enumerate(zip(names, formats)):
        for name, data in files.items():
            yield "image_fuzz", f"{prefix}_{name}", bytes([number]) + data
