"""Builds the package with the messages and stubs of palpate.v1 and the list of settings.

protoc names its modules after the proto package: palpate/v1/pose_pb2.py begins with
`from palpate.v1 import device_pb2`. So the modules go into the package `palpate` itself, where
these imports look. Nothing is rewritten, and no second top-level package called palpate hides
this one.
"""

import pathlib
import shutil
import subprocess

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROTO = ROOT / "proto"


def program(name: str, package: str) -> str:
    """Returns the path of a program of the build. If it is missing, names its Debian package."""
    path = shutil.which(name)
    if path is None:
        raise SystemExit(f"palpate: {name} is missing: apt-get install {package}")
    return path


class BuildWithStubs(build_py):
    """Copies the package and our tools, then lets protoc generate palpate/v1 in the copy."""

    def run(self) -> None:
        super().run()
        protos = sorted(PROTO.glob("palpate/v1/*.proto"))
        if not protos:
            raise SystemExit(f"palpate: no messages in {PROTO}: build in a checkout of the project")
        plugin = program("grpc_python_plugin", "protobuf-compiler-grpc")
        out = pathlib.Path(self.build_lib).resolve()
        shutil.copytree(ROOT / "deploy/tools", out / "palpate/tools", dirs_exist_ok=True)
        protoc = [program("protoc", "protobuf-compiler"), f"--proto_path={PROTO}"]
        subprocess.run(
            [*protoc, f"--python_out={out}", f"--pyi_out={out}", f"--grpc_python_out={out}",
             f"--plugin=protoc-gen-grpc_python={plugin}", *map(str, protos)], check=True)
        subprocess.run(
            [*protoc, f"--plugin=protoc-gen-contract={PROTO}/generate/protoc-gen-contract",
             f"--contract_out={out}", "--contract_opt=python", *map(str, protos)],
            check=True)


setup(cmdclass={"build_py": BuildWithStubs})
