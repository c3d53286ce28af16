"""A rigid tool in the hand, felt with all of its balls."""

import dataclasses
import os
import pathlib
import stat
import tomllib
import typing

import numpy as np

from palpate._errors import InvalidArgument
from palpate._geometry import Triple, three, vector_of
from palpate._values import number, switch, text_of
from palpate.v1 import render_pb2

_MOST_BALLS_OF_A_LINE = 1000
_MOST_BYTES = 256 << 10  # of a file


@dataclasses.dataclass(frozen=True)
class ToolBall:
    """A ball of a rigid tool.

    center_mm: (3,) from the stylus's tip in the stylus's axes, whose z runs along the barrel, away
        from the tip; on the device, mm
    radius_mm: 0: a point
    carves: it carves while carve_tool's button is held
    """

    center_mm: Triple
    radius_mm: float = 0.0
    carves: bool = False


@dataclasses.dataclass(frozen=True)
class Tool:
    """A rigid tool, such as a drill with its shaft: conn.settings.tool.

    balls: at most 64, of at most 3 different radii
    name: for people; at most 31 bytes
    rotation_length_mm: a turn by an angle counts as a way of this length times the angle
    Example: conn.settings.tool = palpate.Tool.read("drill")
    """

    balls: tuple[ToolBall, ...]
    name: str = ""
    rotation_length_mm: float = 30.0

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> "Tool":
        """Reads one of our tools by its name, or a file: its name has a / or ends with .toml.

        Errors: OSError, InvalidArgument. Example: palpate.Tool.read("drill")
        """
        try:
            content = tomllib.loads(_text_of(_file_of(path)))
            balls = [_ball_of(one) for one in content.pop("ball", [])]
            balls += [ball for line in content.pop("line", []) for ball in _balls_of(line)]
            tool = cls(tuple(balls), **content)
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, TypeError, KeyError,
                AttributeError) as error:
            raise InvalidArgument(f"{path} is no tool: {error}") from None
        return typing.cast(Tool, tool_of("tool", tool))


    def scaled(self, scale: float) -> "Tool":
        """All lengths times `scale`, for voxels that are too small or too large for its balls.

        Example: conn.settings.tool = palpate.Tool.read("drill").scaled(0.6)
        """
        balls = tuple(dataclasses.replace(
            ball, center_mm=tuple(scale * np.array(ball.center_mm)),
            radius_mm=scale * ball.radius_mm) for ball in self.balls)
        rotation_mm = (self.rotation_length_mm or 30.0) * scale
        return dataclasses.replace(self, balls=balls,
                                   rotation_length_mm=min(max(rotation_mm, 1.0), 300.0))


def _file_of(path: str | os.PathLike[str]) -> str | os.PathLike[str]:
    """Errors: InvalidArgument (none of our tools)."""
    name = os.fspath(path)
    if "/" in name or name.endswith(".toml"):
        return path
    ours = {file.stem: file for file in (pathlib.Path(__file__).parent / "tools").glob("*.toml")}
    if name not in ours:
        raise InvalidArgument(f"there is no tool {name!r}: there are {', '.join(sorted(ours))}; for "
                              "a file of your own give its name with .toml")
    return ours[name]


def _text_of(path: str | os.PathLike[str]) -> str:
    """Errors: OSError, InvalidArgument (no regular file, or too long)."""
    # O_NONBLOCK: opening a pipe would wait for its writer.
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise InvalidArgument(f"{path} is no regular file")
        text = file.read(_MOST_BYTES + 1)
    if len(text) > _MOST_BYTES:
        raise InvalidArgument(f"{path} is longer than {_MOST_BYTES >> 10} KiB")
    return text.decode("utf-8")


def tool_of(name: str, value: typing.Any) -> Tool | None:
    """The tool of a message, or of a caller. Errors: InvalidArgument."""
    if isinstance(value, render_pb2.HeldTool):
        if not value.ball:
            return None
        balls = tuple(ToolBall((ball.center_mm.x, ball.center_mm.y, ball.center_mm.z),
                               ball.radius_mm, ball.carves) for ball in value.ball)
        return Tool(balls, value.name, value.rotation_length_mm or 30.0)
    if value is None:
        return None
    if not isinstance(value, Tool):
        raise InvalidArgument(f"{name} is a palpate.Tool or None, not {value!r}")
    if not value.balls:
        raise InvalidArgument(f"{name} has no balls; None puts it down")
    for ball in value.balls:
        if not isinstance(ball, ToolBall):
            raise InvalidArgument(f"the balls of {name} are palpate.ToolBall(...), not {ball!r}")
    return dataclasses.replace(value, balls=tuple(
        dataclasses.replace(ball, center_mm=three("center_mm", ball.center_mm))
        for ball in value.balls))


def put_tool(tool: Tool | None, message: render_pb2.HeldTool) -> None:
    """Errors: InvalidArgument."""
    message.SetInParent()
    if tool is None:
        return
    message.name = text_of("name", tool.name)
    message.rotation_length_mm = number("rotation_length_mm", tool.rotation_length_mm)
    for ball in tool.balls:
        message.ball.add(center_mm=vector_of("center_mm", ball.center_mm),
                         radius_mm=number("radius_mm", ball.radius_mm),
                         carves=switch("carves", ball.carves))


def _ball_of(table: dict[str, typing.Any]) -> ToolBall:
    ball = ToolBall(**table)
    return dataclasses.replace(ball, center_mm=three("center_mm", ball.center_mm))


def _balls_of(line: dict[str, typing.Any]) -> list[ToolBall]:
    begin, end = (np.array(three(key, line.pop(key))) for key in ("from_mm", "to_mm"))
    count = line.pop("count")
    if not isinstance(count, int) or not 2 <= count <= _MOST_BALLS_OF_A_LINE:
        raise InvalidArgument("count is a whole number of balls, 2 at least")
    return [ToolBall(tuple(begin + share * (end - begin)), **line)
            for share in np.linspace(0.0, 1.0, count)]
