#!/bin/sh
# The installed clients against a palpated that runs, in the root to test: command line,
# Python, the viewer without a window, and a program built on the library. The folder
# with the library's example is the argument.
set -e
palpate info >/dev/null
palpate set stiffness 0.6 >/dev/null
palpate settings | grep -q 'stiffness *0.6'
palpate watch --seconds 1 | tail -n 1
palpate doctor | grep '^ok   daemon' # it may find faults of this machine

python3 - <<'PYTHON'
import palpate

with palpate.connect() as connection:
    with connection.poses(rate_hz=100, batch=10) as stream:
        poses = next(stream)
    assert poses.force_n.shape == (10, 3), poses.force_n.shape
    connection.settings.isovalue = 0.4
    assert connection.settings.isovalue == 0.4
    values = connection.volume.download().values
    print(f"python: {len(poses.tick)} poses, {values.shape} voxels")
PYTHON

palpate-view --offscreen --size 320x200 --screenshot /tmp/picture.png
python3 - <<'PYTHON'
import struct
picture = open("/tmp/picture.png", "rb").read()
assert picture[:8] == b"\x89PNG\r\n\x1a\n"
assert struct.unpack(">II", picture[16:24]) == (320, 200)
assert len(picture) > 5000, "hardly anything is drawn"
print(f"palpate-view: a picture of {len(picture)} bytes")
PYTHON

cmake -S "$1" -B /tmp/example >/tmp/example.log
cmake --build /tmp/example >>/tmp/example.log || { tail -n 30 /tmp/example.log; exit 1; }
/tmp/example/example /run/palpate/palpated.sock 0.3
palpate settings | grep -q 'isovalue *0.3'
