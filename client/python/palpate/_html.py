"""The display of an object in a notebook: a small table, and for some objects a picture."""

import base64
import collections.abc
import html
import struct
import typing
import zlib

import numpy as np
import numpy.typing as npt

MOST_PIXELS = 384
_SHOWN_PIXELS = 256

Rows = collections.abc.Iterable[tuple[str, object]]


def table(title: str, rows: Rows, picture: str = "") -> str:
    """Escapes everything except `picture`, a tag made by picture_of()."""
    cells = "".join(f"<tr><th style='text-align:left'>{_text(name)}</th>"
                    f"<td style='text-align:left'>{_text(value)}</td></tr>"
                    for name, value in rows)
    return f"<div><b>{_text(title)}</b><table>{cells}</table>{picture}</div>"


def numbers(values: npt.ArrayLike) -> str:
    """Short: 1 × 0.5 × 0.5."""
    return " × ".join(f"{value:g}" for value in np.asarray(values).tolist())


def picture_of(slice_xy: npt.NDArray[typing.Any], low: float, high: float,
               size_mm: tuple[float, float], about: str) -> str:
    """An image of (nx, ny): x to the right, y down, black at `low` and white at `high`."""
    step = max(1, -(-max(slice_xy.shape) // MOST_PIXELS))
    rows = slice_xy[::step, ::step].T.astype(np.float64)
    span = high - low if high > low else 1.0
    with np.errstate(all="ignore"):
        gray = np.nan_to_num((rows - low) / span).clip(0, 1) * 255
    data = base64.b64encode(_png(gray.astype(np.uint8))).decode()
    scale = _SHOWN_PIXELS / max(*size_mm, 1e-12)
    width, height = (max(1, round(mm * scale)) for mm in size_mm)
    return (f"<img alt='{_text(about)}' title='{_text(about)}' width='{width}' height='{height}' "
            f"src='data:image/png;base64,{data}'>")


def _png(gray: npt.NDArray[np.uint8]) -> bytes:
    """(rows, columns)"""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))

    height, width = gray.shape
    # Each row begins with the number of its filter; 0: none.
    rows = np.zeros((height, width + 1), np.uint8)
    rows[:, 1:] = gray
    # 8 bits per pixel, gray.
    header = struct.pack(">2I5B", width, height, 8, 0, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
            + chunk(b"IDAT", zlib.compress(rows.tobytes())) + chunk(b"IEND", b""))


def _text(value: object) -> str:
    return html.escape(str(value), quote=True)
