"""README.md and deploy/guides: every command block runs, and every link leads somewhere; and
deploy/demo.sh, the README's first command.

A page's blocks run in order, in one shell (```sh) and one Python (```python), in a folder that has
the files which the pages name: a DICOM folder `scan`, `head.nrrd`, `t*.nrrd`, my-tool.toml,
palpated.toml and palpate-web.toml. A block that cannot run here says why on the line above it:
<!-- not run: REASON -->."""

import concurrent.futures
import dataclasses
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest
import urllib.request

import numpy as np

from dicom_series import dicom_slice
from free_port import free_port
from support import nrrd

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "deploy/guides").glob("*.md"))]
# Only linked: their blocks belong to other tests, or to the machine of who follows them.
LINKED = [*PAGES, ROOT / "client/python/README.md", *sorted((ROOT / "tests").glob("**/*.md"))]
PROGRAMS = pathlib.Path(os.environ["PALPATED"]).parent
RUN = ("sh", "python")
SHOWN = ("cmake", "cpp", "ini", "promql", "text", "toml", "yaml")
PATIENCE_S = 300

FENCE = re.compile(r"^```(.*)$")
REASON = re.compile(r"^<!-- not run: (.*) -->$")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
# Ends what the page has started: a daemon that does not end in order fails the page. nats-server's
# order is to end with 1.
EPILOGUE = """
for job in $(jobs -p); do
  name=$(cat "/proc/$job/comm")
  kill -TERM "$job"
  wait "$job" || [ $?-$name = 1-nats-server ]
done
"""


@dataclasses.dataclass
class Block:
    page: pathlib.Path
    line: int
    language: str
    reason: str | None
    text: str

    def __str__(self):
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page):
    """The page's code blocks, in order."""
    found, start, previous = [], None, ""
    lines = page.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, 1):
        fence = FENCE.match(line)
        if not fence:
            previous = line if start is None else previous
        elif start is None:
            start, language = number, fence[1].strip()
            reason = REASON.match(previous)
        else:
            found.append(Block(page, start, language, reason and reason[1],
                               "\n".join(lines[start:number - 1]) + "\n"))
            start, previous = None, ""
    if start is not None:
        raise ValueError(f"{page}:{start}: this block has no end")
    return found


def anchors(page):
    """Of its headings, as GitHub names them."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def ball(size, number=0):
    """Densities of a ball, x fastest, from -1000 outside to 1000 inside."""
    k, j, i = np.indices((size,) * 3) - (size - 1) / 2
    values = 200 * (size / 3 + number - np.sqrt(i**2 + j**2 + k**2))
    return values.clip(-1000, 1000).astype("<i2")


def make_files(folder):
    """What the pages call by name."""
    size = 32
    (folder / "scan").mkdir()
    for z, values in enumerate(ball(size)):
        (folder / f"scan/slice_{z:03}.dcm").write_bytes(
            dicom_slice(z, size, size, values.tobytes()))
    for name, number in (("head", 0), ("t0", 0), ("t1", 1), ("t2", 2)):
        (folder / f"{name}.nrrd").write_bytes(
            nrrd(ball(size, number), np.diag([3, 3, 3]).tolist(), (-48, -48, -48)))
    shutil.copy(ROOT / "deploy/tools/drill.toml", folder / "my-tool.toml")
    for program in ("palpated", "palpate-web"):
        config = (ROOT / f"deploy/config/{program}.toml").read_text(encoding="utf-8")
        (folder / f"{program}.toml").write_text(
            config.replace("/usr/share/palpate/web", str(PROGRAMS.parent / "web")))
        (folder / f"{program}.toml").chmod(0o644)  # palpate-web refuses what others may write


def script(page_blocks):
    """One shell script that says each block's place before it runs it."""
    text = "set -eo pipefail\n"
    for block in page_blocks:
        body = block.text
        if block.language == "python":
            body = f"{sys.executable} <<'END_OF_PYTHON'\n{body}END_OF_PYTHON\n"
        text += f"echo '== {block}'\n{body}"
    # Others may have the ports that the pages name.
    for port in ("4222", "7400", "7480", "7481"):
        text = text.replace(port, str(free_port()))
    return text + "echo '== the end of the page'\n" + EPILOGUE


def run_page(page):
    """(exit status, what it printed) of a page's blocks."""
    page_blocks = [block for block in blocks(page)
                   if block.language in RUN and not block.reason]
    if not page_blocks:
        return 0, ""
    with tempfile.TemporaryDirectory(prefix="palpate-guides-") as name:
        folder = pathlib.Path(name)
        make_files(folder)
        environment = {key: value for key, value in os.environ.items()
                       if not key.startswith(("PALPATE_", "XDG_"))}
        environment |= {"PATH": f"{PROGRAMS}:{os.environ['PATH']}", "HOME": name, "TMPDIR": name,
                        "PALPATE_SOCKET": f"{name}/palpated.sock", "GRPC_VERBOSITY": "NONE",
                        "XDG_STATE_HOME": f"{name}/state"}
        with tempfile.TemporaryFile("w+", errors="replace") as log:
            # A group of its own: what the page leaves behind when it fails is ended, too.
            with subprocess.Popen(["bash", "-c", script(page_blocks)], cwd=name, env=environment,
                                  stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                                  start_new_session=True) as shell:
                try:
                    status = shell.wait(PATIENCE_S)
                except subprocess.TimeoutExpired:
                    status = "none: it did not end"
                try:
                    os.killpg(shell.pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
            log.seek(0)
            return status, log.read()


class Guides(unittest.TestCase):
    def test_every_block_has_a_language_and_runs_or_says_why_not(self):
        ran, left_out = 0, []
        for page in PAGES:
            for block in blocks(page):
                self.assertIn(block.language, RUN + SHOWN, f"{block}: name the block's language")
                if block.language in RUN:
                    ran += not block.reason
                    if block.reason:
                        left_out.append(f"{block}: {block.reason}")
        print(f"{ran} blocks run, {len(left_out)} do not:", *left_out, sep="\n  ")
        self.assertGreater(ran, len(left_out))

    def test_every_block_runs(self):
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            for page, (status, log) in zip(PAGES, pool.map(run_page, PAGES)):
                with self.subTest(page=page.name):
                    last = [line for line in log.splitlines() if line.startswith("== ")][-1:]
                    self.assertEqual(status, 0, f"after {last}:\n{log[-6000:]}")

    def test_every_link_leads_somewhere(self):
        for page in LINKED:
            text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
            for link in LINK.findall(text):
                if re.match(r"[a-z]+:", link):
                    continue
                path, _, anchor = link.partition("#")
                target = (page.parent / path).resolve() if path else page
                with self.subTest(page=str(page.relative_to(ROOT)), link=link):
                    self.assertTrue(target.exists(), "there is no such file")
                    if anchor:
                        self.assertIn(anchor, anchors(target), "there is no such heading")


@unittest.skipUnless(PROGRAMS == ROOT / "build/bin", "the demo runs what is in build/")
class Demo(unittest.TestCase):
    def test_the_watch_begins_when_the_daemon_serves(self):
        # Who never sleeps sees the socket before anybody listens on it.
        with tempfile.TemporaryDirectory(prefix="palpate-demo-test-") as folder:
            sleep = pathlib.Path(folder) / "sleep"
            sleep.write_text("#!/bin/sh\n")
            sleep.chmod(0o755)
            environment = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}",
                                        "TMPDIR": folder}
            for _ in range(3):
                run = subprocess.run([ROOT / "deploy/demo.sh", "--seconds", "3"], text=True,
                                     env=environment, capture_output=True, timeout=PATIENCE_S)
                self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
                self.assertRegex(run.stdout, r"samples +[1-9]\d*, \d+ dropped")
            self.assertEqual(os.listdir(folder), ["sleep"])

    @unittest.skipUnless((ROOT / "build/web/app.js").exists(), "the page is not built")
    def test_the_link_of_the_web_demo_lets_a_guest_in(self):
        with tempfile.TemporaryDirectory(prefix="palpate-demo-test-") as folder:
            command = [ROOT / "deploy/demo.sh", "--web-port", str(free_port())]
            with subprocess.Popen(command, text=True, stdout=subprocess.PIPE,
                                  env=os.environ | {"TMPDIR": folder}) as demo:
                link = next((found for line in demo.stdout
                             if (found := re.search(r"(http://\S+)/#room=(\w+)$", line))), None)
                self.assertIsNotNone(link, "no link")
                page, key = link.groups()
                self.assertIn("app.js", urllib.request.urlopen(page).read().decode())
                login = urllib.request.Request(f"{page}/login", json.dumps({"room": key}).encode(), {
                    "Content-Type": "application/json", "Origin": page})
                self.assertEqual(urllib.request.urlopen(login).status, 200)
                demo.send_signal(signal.SIGINT)
                self.assertEqual(demo.wait(PATIENCE_S), 0)
            self.assertEqual(os.listdir(folder), [])


if __name__ == "__main__":
    unittest.main()
