"""A DICOM series of plain CT slices, in the explicit little-endian encoding."""

import struct

CT_IMAGE, SERIES = "1.2.840.10008.5.1.4.1.1.2", "1.2.826.0.1.3680043.8.498.1"


def element(group, number, kind, value):
    if isinstance(value, str):
        value = value.encode() + (b"\0" if kind == "UI" else b" ") * (len(value) % 2)
    elif isinstance(value, int):
        value = struct.pack("<H", value)
    length = struct.pack("<HI", 0, len(value)) if kind in ("OB", "OW") else struct.pack(
        "<H", len(value))
    return struct.pack("<HH", group, number) + kind.encode() + length + value


def dicom_slice(z, size_x, size_y, voxels, spacing_z_mm=2):
    """A file's bytes; voxels: of 16 bits, signed, x fastest."""
    name = f"{SERIES}.{z + 1}"
    meta = b"".join((element(2, 1, "OB", b"\0\1"), element(2, 2, "UI", CT_IMAGE),
                     element(2, 3, "UI", name), element(2, 0x10, "UI", "1.2.840.10008.1.2.1"),
                     element(2, 0x12, "UI", "1.2.3")))
    meta = element(2, 0, "UL", struct.pack("<I", len(meta))) + meta
    return bytes(128) + b"DICM" + meta + b"".join(
        element(*each) for each in (
            (8, 0x16, "UI", CT_IMAGE), (8, 0x18, "UI", name), (8, 0x60, "CS", "CT"),
            (0x20, 0xd, "UI", SERIES), (0x20, 0xe, "UI", f"{SERIES}.0"),
            (0x20, 0x13, "IS", str(z + 1)), (0x20, 0x32, "DS", f"0\\0\\{spacing_z_mm * z}"),
            (0x20, 0x37, "DS", "1\\0\\0\\0\\1\\0"), (0x28, 2, "US", 1),
            (0x28, 4, "CS", "MONOCHROME2"), (0x28, 0x10, "US", size_y), (0x28, 0x11, "US", size_x),
            (0x28, 0x30, "DS", "2\\2"), (0x28, 0x100, "US", 16), (0x28, 0x101, "US", 16),
            (0x28, 0x102, "US", 15), (0x28, 0x103, "US", 1), (0x28, 0x1052, "DS", "0"),
            (0x28, 0x1053, "DS", "1"), (0x7fe0, 0x10, "OW", voxels)))
