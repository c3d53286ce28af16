#!/usr/bin/env python3
"""Draws the live view of `palpate watch` as an SVG picture, from a real run.

Usage: deploy/guides/watch_picture.py OUTPUT.svg VOLUME NORMALIZED_ISOVALUE

Runs deploy/demo.sh on a terminal of its own until the proxy is in contact, and
keeps that frame.
"""

import html
import os
import pty
import re
import signal
import sys
import time

COLUMNS, ROWS = 80, 14
PATIENCE_S = 60
LEAST_S = 8  # so that the figures have settled


def frames(command):
    """Texts of the screen, frame by frame, until the caller stops asking."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ.update(TERM="xterm", COLUMNS=str(COLUMNS), LINES=str(ROWS))
        os.execvp(command[0], command)
    try:
        pending = ""
        while True:
            pending += os.read(terminal, 65536).decode(errors="replace")
            # A frame is drawn from the top of the view down.
            *complete, pending = re.split(r"(?=palpated at )", pending)
            for text in complete:
                clean = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", text)
                yield [line.rstrip() for line in clean.splitlines() if line.strip()]
    finally:
        os.kill(pid, signal.SIGINT)
        try:
            while os.read(terminal, 65536):
                pass  # it must not block on a full terminal
        except OSError:
            pass  # the end of a terminal
        os.waitpid(pid, 0)


def svg(lines):
    width, height = 9 * COLUMNS + 24, 20 * len(lines) + 28
    rows = "\n".join(
        f'  <text x="12" y="{28 + 20 * n}" xml:space="preserve">{html.escape(line)}</text>'
        for n, line in enumerate(lines))
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}">\n'
            f'  <rect width="100%" height="100%" rx="6" fill="#16191d"/>\n'
            f'  <g font-family="monospace" font-size="15" fill="#d7dde4">\n{rows}\n  </g>\n</svg>\n')


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    output, volume, isovalue = sys.argv[1:]
    demo = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "demo.sh")
    start = time.monotonic()
    for lines in frames([demo, "--volume", volume, "--normalized-isovalue", isovalue]):
        waited = time.monotonic() - start
        if waited > PATIENCE_S:
            sys.exit("watch_picture: no contact within a minute")
        if waited > LEAST_S and any("in contact" in line for line in lines):
            # The socket is that of a temporary folder.
            lines[0] = re.sub(r"unix:\S+/", "unix:", lines[0])
            with open(output, "w", encoding="utf-8") as file:
                file.write(svg(lines))
            return


if __name__ == "__main__":
    main()
