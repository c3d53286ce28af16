"""What notebooks show, and that the example notebook runs."""

import base64
import dataclasses
import io
import json
import os
import pathlib
import re
import unittest
import xml.etree.ElementTree

import numpy as np
from PIL import Image

import palpate
from palpate._bricks import Bricks
from support import PATIENCE_S, Daemon, DaemonTest

NOTEBOOK = pathlib.Path(__file__).resolve().parents[2] / "client/python/examples/first_steps.ipynb"
EVIL = "<script>alert(1)</script>&'\""


def pixels(page):
    """(rows, columns) of the picture in it."""
    data = base64.b64decode(re.search("data:image/png;base64,([^']*)'", page)[1])
    Image.open(io.BytesIO(data)).verify()  # the sums of its chunks
    picture = Image.open(io.BytesIO(data))
    assert picture.mode == "L"
    return np.asarray(picture)


class Shown(DaemonTest):
    def page(self, held):
        """Its HTML, which is well-formed."""
        page = held._repr_html_()
        # XML has no empty tag but with a slash.
        xml.etree.ElementTree.fromstring(re.sub("(<img [^>]*)>", r"\1/>", page))
        return page

    def test_connection(self):
        page = self.page(self.conn)
        for part in (self.daemon.socket, "builtin:sphere:48", "48 × 48 × 48"):
            self.assertIn(part, page)
        with self.daemon.connect() as closed:
            pass
        self.assertIn("was closed", self.page(closed))

    def test_the_middle_slice(self):
        values = np.zeros((40, 20, 9), np.float32)
        values[30, 5, 4] = 2.0
        values[10, 5, 4] = 1.0
        values[:, :, 3] = values[:, :, 5] = 2.0
        self.conn.volume.upload(values, (1, 2, 1))
        page = self.page(self.conn.volume.download())
        picture = pixels(page)
        self.assertEqual(picture.shape, (20, 40))
        self.assertEqual((picture[5, 30], picture[5, 10], np.count_nonzero(picture)),
                         (255, 127, 2))
        # As wide as high: voxels are twice as long along y.
        self.assertIn("width='256' height='256'", page)

    def test_large_flat_and_odd_volumes(self):
        volume = self.conn.volume.download()
        for size, value, shape in (((1000, 3, 2), 0.0, (1, 334)), ((1, 1, 1), 1.0, (1, 1)),
                                   ((3, 4, 5), np.nan, (4, 3)), ((3, 4, 5), np.inf, (4, 3)),
                                   ((1 << 20, 1 << 14, 4), 1.0, (6, 384))):
            bricks = Bricks(size, np.dtype(np.float32), value)
            odd = dataclasses.replace(volume, _bricks=bricks, value_min=1.0, value_max=1.0)
            self.assertEqual(pixels(self.page(odd)).shape, shape)

    def test_ticks(self):
        poses = next(self.conn.poses(1000, 100))
        self.assertIn("<td style='text-align:left'>100</td>", self.page(poses))
        empty = palpate.Poses(**{
            field.name: held[:0] if isinstance(held := getattr(poses, field.name), np.ndarray)
            else held for field in dataclasses.fields(poses)})
        self.page(empty)
        file = self.daemon.folder / "shown.mcap"
        self.conn.recording.start(file)
        next(self.conn.poses(100, 10))
        self.conn.recording.stop()
        recording = palpate.open_recording(file)
        self.assertIn(str(len(recording.ticks)), self.page(recording.ticks))
        self.assertIn("shown.mcap", self.page(recording))

    def test_all_is_escaped(self):
        info, volume = self.conn.volume.info(), self.conn.volume.download()
        for held in (dataclasses.replace(info, source=EVIL, unit=EVIL, original_type=EVIL,
                                         warnings=(EVIL,)),
                     dataclasses.replace(volume, source=EVIL, unit=EVIL)):
            page = self.page(held)
            self.assertNotIn("<script", page)
            self.assertIn("&lt;script&gt;", page)


class Notebook(unittest.TestCase):
    def test_it_stores_no_outputs(self):
        for cell in json.loads(NOTEBOOK.read_text())["cells"]:
            if cell["cell_type"] == "code":
                self.assertEqual((cell["outputs"], cell["execution_count"]), ([], None))

    def test_it_runs(self):
        try:
            import ipykernel  # noqa: F401
            import nbclient
            import nbformat
        except ImportError:
            self.skipTest("nbclient or ipykernel is not installed")
        notebook = nbformat.read(NOTEBOOK, 4)
        nbformat.validate(notebook)
        with Daemon() as daemon:
            environment = {name: held for name, held in os.environ.items()
                           if name not in ("PALPATE_SERVER", "PALPATE_SOCKET")}
            # Folders of its own: what the user has there is no part of the test.
            environment |= {"PALPATE_SOCKET": daemon.socket, "HOME": str(daemon.folder),
                            "JUPYTER_RUNTIME_DIR": str(daemon.folder / "jupyter"),
                            "IPYTHONDIR": str(daemon.folder / "ipython")}
            client = nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3")
            # It ends by itself, also where the machine is busy.
            client.create_kernel_manager().shutdown_wait_time = PATIENCE_S
            client.execute(env=environment)
        shown = {cell["id"]: [output["data"] for output in cell["outputs"] if "data" in output]
                 for cell in notebook["cells"] if cell["cell_type"] == "code"}
        for name in ("connect", "volume", "poses", "edit"):
            self.assertIn("palpate", shown[name][-1]["text/html"], name)
        self.assertIn("data:image/png", shown["volume"][-1]["text/html"])
