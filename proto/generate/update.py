#!/usr/bin/python3
"""Writes what the contract declares into files of the source tree: C++ (common/contract,
common/wire/values, lists of settings, the layout of recorded ticks), the settings in
deploy/config/palpated.toml and deploy/guides/settings.md, and what enumerators say, in the page's
words.ts. Run it when the contract has changed.

--check: only says which file has something else; exit code 1 then.
"""

import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
# File: what is written of it, and between which lines; none: all of it.
FILES = {"deploy/config/palpated.toml": ("haptics.toml", "# (", ")"),
         "deploy/guides/settings.md": ("settings.md", "<!-- ", " -->"),
         "client/web/page/src/wire/words.ts": ("words.ts", None, None)}
BEGIN = "The list of settings begins. It is written by proto/generate/update.py."
END = "The list of settings ends."


def written(kind: str) -> dict[str, str]:
    """What the contract says now, by the names of its files. kind: as protoc-gen-contract has it."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        subprocess.run(
            ["protoc", f"--proto_path={ROOT}/proto", f"--contract_out={folder}",
             f"--plugin=protoc-gen-contract={HERE}/protoc-gen-contract", f"--contract_opt={kind}",
             *sorted(map(str, (ROOT / "proto").glob("palpate/v1/*.proto")))], check=True)
        return {str(path.relative_to(folder)): path.read_text()
                for path in folder.rglob("*") if path.is_file()}


def with_list(text: str, listed: str, begin: str, end: str) -> str:
    """The text with this between its two lines."""
    before, _, rest = text.partition(f"{begin}\n")
    _, found, after = rest.partition(end)
    if not found:
        raise SystemExit(f"there are no lines '{begin}' and '{end}'")
    return f"{before}{begin}\n{listed}{end}{after}"


def main() -> int:
    check = sys.argv[1:] == ["--check"]
    if sys.argv[1:] and not check:
        raise SystemExit(__doc__)
    files, lists = written("cpp"), written("texts")
    for name, (listed, left, right) in FILES.items():
        files[name] = lists[listed]
        if left is not None:
            files[name] = with_list((ROOT / name).read_text(), lists[listed],
                                    f"{left}{BEGIN}{right}", f"{left}{END}{right}")
    gone = {str(path.relative_to(ROOT)) for path in (ROOT / "common/contract").glob("*.h")
            if path.name != "enumeration.h"} - files.keys()
    if gone:
        raise SystemExit(f"not written any more: delete {' '.join(sorted(gone))}")
    stale = 0
    for name, now in files.items():
        path = ROOT / name
        if path.exists() and path.read_text() == now:
            continue
        stale += 1
        print(f"{name}: "
              f"{'not as the contract has it: run proto/generate/update.py' if check else 'written'}")
        if not check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(now)
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
