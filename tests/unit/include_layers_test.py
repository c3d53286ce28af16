"""The layers of the tree, read off the #include lines: Debian keeps every header
in /usr/include, so that the compiler lets anything pass."""

import functools
import os
import pathlib
import re
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]

MAPS = ["common/README.md", "server/README.md", "client/README.md"]
COMMON = ["common/bricks", "common/error", "common/files", "common/geometry", "common/isosurface"]

# What the contract declares is everybody's.
EVERYBODYS = "common/contract"
# Folder: folders it may include, besides itself.
LAYERS = {
    "common/arguments": [],
    "common/bricks": ["common/error", "common/geometry"],
    "common/contract": ["common/geometry"],
    "common/error": [],
    "common/files": ["common/error", "common/geometry"],
    "common/geometry": [],
    "common/isosurface": ["common/geometry"],
    "common/felt_tool": ["common/error", "common/files", "common/geometry"],
    "common/wire": COMMON,
    "server/log": ["server/realtime"],
    "server/realtime": ["common/error"],
    "server/volume/snapshot": COMMON + ["common/felt_tool"],
    "server/volume/load": COMMON + ["server/volume/snapshot"],
    "server/volume/edit": COMMON + ["server/volume/snapshot", "server/volume/load"],
    "server/volume/save": COMMON + ["server/volume/snapshot", "server/volume/load"],
    "server/import": ["common/arguments", "common/bricks", "common/error", "common/files",
                      "common/geometry", "server/volume/snapshot", "server/volume/load",
                      "server/volume/save"],
    "server/haptics": ["common/geometry", "common/isosurface", "server/volume/snapshot"],
    "server/haptics/tool": ["common/geometry", "common/isosurface",
                            "server/haptics"],
    "server/device": ["common/error", "common/geometry", "server/realtime"],
    "server/device/stream": ["common/error", "common/geometry", "server/device",
                             "server/realtime"],
    "server/device/usb": ["common/error", "common/geometry", "server/device",
                          "server/device/stream", "server/realtime"],
    "server/device/firewire": ["common/error", "server/device/stream"],
    "server/device/omni": ["common/error", "common/geometry", "server/device",
                           "server/device/firewire", "server/device/stream", "server/device/usb",
                           "server/realtime"],
    "server/device/falcon": ["common/error", "common/geometry", "server/device",
                             "server/device/stream", "server/device/usb"],
    "server/device/openhaptics": ["common/error", "common/geometry", "server/device", "server/device/stream",
                                  "server/realtime"],
    "server/device/forcedimension": ["common/error", "common/geometry", "server/device",
                                     "server/device/stream", "server/realtime"],
    "server/device/haply": ["common/error", "common/geometry", "server/device",
                            "server/device/stream", "server/realtime"],
    "server/safety": ["common/geometry", "server/device"],
    "server/felt": COMMON + ["server/realtime", "server/volume/snapshot", "server/haptics",
                              "server/haptics/tool",
                              "server/device"],
    "server/pump": ["common/geometry", "server/realtime", "server/haptics", "server/safety",
                       "server/felt"],
    "server/servo": ["server/realtime", "server/haptics", "server/haptics/tool", "server/device", "server/safety",
                     "server/felt", "server/pump"],
    "server/stop": ["common/error", "common/files", "server/realtime", "server/device",
                    "server/pump", "server/servo"],
    "server/live_volume": COMMON + ["server/realtime", "server/volume/snapshot",
                                    "server/volume/load", "server/volume/edit", "server/haptics"],
    "server/kept": COMMON + ["common/felt_tool", "server/log", "server/haptics", "server/felt",
                              "server/live_volume"],
    "server/client_paths": COMMON + ["server/volume/load", "server/live_volume", "server/kept"],
    "server/session": COMMON + ["common/felt_tool", "server/log", "server/realtime", "server/volume/snapshot",
                                "server/volume/load", "server/haptics", "server/haptics/tool",
                                "server/device", "server/felt", "server/pump", "server/live_volume",
                                "server/kept"],
    "server/session/edits": COMMON + ["server/volume/snapshot", "server/volume/edit",
                                      "server/session"],
    "server/session/series": COMMON + ["server/log", "server/volume/snapshot",
                                       "server/live_volume", "server/client_paths",
                                       "server/session"],
    "server/session/tools": ["server/log", "server/felt", "server/pump", "server/session",
                             "server/session/edits"],
    "server/simulated_hand": COMMON + ["server/realtime", "server/haptics", "server/device",
                                       "server/session"],
    "server/recording": COMMON + ["common/wire", "server/realtime", "server/volume/snapshot",
                                  "server/haptics", "server/device", "server/safety", "server/felt",
                                  "server/pump", "server/servo", "server/session"],
    "server/volume_stream": COMMON + ["server/volume/snapshot", "server/session"],
    "server/security": ["common/error", "common/files", "server/log"],
    "server/metrics": COMMON + ["common/wire", "server/realtime", "server/device", "server/safety",
                                "server/pump", "server/servo", "server/live_volume",
                                "server/recording"],
    "server/door": COMMON + ["common/wire", "server/log",
                    "server/realtime", "server/security"],
    "server/services": COMMON + ["common/wire", "server/log", "server/security", "server/door",
                                 "server/realtime", "server/volume/edit", "server/volume/save",
                                 "server/haptics", "server/device", "server/safety", "server/pump",
                                 "server/servo", "server/stop", "server/client_paths",
                                 "server/session", "server/session/edits",
                                 "server/session/series", "server/simulated_hand",
                                 "server/recording", "server/volume_stream", "server/metrics"],
    "server/app": COMMON + ["common/arguments", "common/wire", "server/log", "server/realtime",
                            "server/haptics", "server/simulated_hand", "server/device",
                            "server/device/stream", "server/device/usb",
                            "server/device/firewire", "server/device/omni", "server/device/falcon",
                            "server/device/forcedimension", "server/device/haply",
                            "server/device/openhaptics", "server/safety", "server/pump",
                            "server/servo", "server/stop", "server/live_volume", "server/kept",
                            "server/client_paths", "server/session", "server/session/edits",
                            "server/session/series", "server/session/tools", "server/recording",
                            "server/security",
                            "server/metrics",
                            "server/door", "server/services"],
    "server/lab": COMMON + ["common/arguments", "server/volume/snapshot", "server/volume/load",
                            "server/live_volume", "server/haptics", "server/haptics/tool",
                            "server/servo", "server/simulated_hand", "server/recording"],
    "client/cli/doctor": [],
    "client/sdk": COMMON + ["common/wire"],
    "client/sdk/example": ["client/sdk"],
    "client/program": COMMON + ["common/arguments", "client/sdk"],
    "client/web/wire": ["common/error", "common/wire"],
    "client/web/volume": ["common/bricks", "common/error", "common/geometry", "client/sdk"],
    "client/web/hub": ["client/web/volume", "client/web/wire"],
    "client/web/logins": ["common/error", "client/sdk"],
    "client/web/http": ["common/error", "common/wire", "client/web/logins", "client/web/hub",
                        "client/web/volume"],
    "client/web/upstream": ["common/bricks", "common/error", "common/geometry", "common/wire",
                          "client/sdk", "client/web/hub", "client/web/volume",
                            "client/web/wire"],
    "client/web/room": ["common/bricks", "common/error", "common/geometry", "common/wire",
                        "client/sdk", "client/web/logins", "client/web/hub", "client/web/upstream",
                        "client/web/volume", "client/web/wire"],
    "client/web/app": ["common/arguments", "common/error", "common/wire", "client/program",
                       "client/sdk", "client/web/logins", "client/web/http", "client/web/hub",
                       "client/web/room", "client/web/upstream", "client/web/volume"],
    "client/files": COMMON + ["client/sdk"],
    "client/cli": COMMON + ["common/arguments", "common/felt_tool", "common/wire", "client/program",
                            "client/cli/doctor", "client/files", "client/sdk"],
    "client/shading": [],
    "client/view/volume": COMMON + ["client/sdk"],
    "client/view/drawing": COMMON + ["client/sdk", "client/view/volume"],
    "client/view/render": COMMON + ["client/shading", "client/view/volume", "client/view/drawing"],
    "client/view/palpated": COMMON + ["common/felt_tool", "client/files", "client/sdk", "client/view/volume"],
    "client/view/viewer": COMMON + ["common/arguments", "common/felt_tool", "common/wire",
                                    "client/program",
                                    "client/sdk", "client/view/volume", "client/view/drawing",
                                    "client/view/render", "client/view/palpated"],
    "client/view/panels": COMMON + ["common/felt_tool", "client/sdk", "client/view/drawing", "client/view/palpated",
                                    "client/view/viewer"],
    "client/view/window": COMMON + ["common/arguments", "client/program", "client/sdk",
                                    "client/view/render", "client/view/viewer",
                                    "client/view/panels"],
}

# Library: its includes, and the folders that may use it.
LIBRARIES = {
    "gRPC and protobuf": (r"grpc|google/protobuf|palpate/v1/",
                          ["common/wire", "server/recording", "server/door", "server/services", "server/app",
                           "client/sdk", "client/web/wire"]),
    "CLI11": (r"CLI/", ["common/arguments"]),
    "OpenVDB": (r"openvdb/", ["server/volume/snapshot", "server/volume/load", "server/volume/edit",
                               "server/volume/save", "server/import", "server/lab", "client/files"]),
    "GDCM": (r"gdcm", ["server/import"]),
    "libtiff": (r"tiff", ["server/import"]),
    "pugixml": (r"pugixml", ["server/import"]),
    "libsystemd": (r"systemd/", ["server/app", "client/web/app"]),
    "libusb": (r"libusb", ["server/device/usb"]),
    "toml++": (r"toml\+\+/", ["common/felt_tool", "server/security", "server/kept", "server/app",
                               "client/cli/doctor", "client/sdk", "client/web/app"]),
    "Boost.Asio and Boost.Beast": (r"boost/(asio|beast)", [
        "server/device/haply", "client/web/http", "client/web/app"]),
    "spdlog": (r"spdlog/", ["server/log", "server/app"]),
    "OpenSSL": (r"openssl/", ["server/security", "client/cli/doctor", "client/web/logins",
                              "client/web/http"]),
    "prometheus-cpp": (r"prometheus/", ["server/metrics", "server/app", "client/web/app"]),
    "TBB": (r"tbb/", ["server/volume/load", "server/volume/edit", "server/app", "server/lab"]),
    "OpenGL": (r"epoxy/|GL/", ["client/view/render", "client/view/viewer",
                                 "client/view/panels", "client/view/window"]),
    "Dear ImGui": (r"imgui|backends/imgui", ["client/view/viewer", "client/view/panels",
                                             "client/view/window"]),
    "GLFW, libpng": (r"GLFW/|png", ["client/view/window"]),
    "libnats": (r"nats/", ["client/web/room"]),
    "zstd and xxHash": (r"zstd|xxhash", ["common/bricks", "server/recording"]),
}

# What a file names: the header that it, or one of ours that it includes, must include. The
# precompiled headers would hide that one is missing.
NAMES = {
    r"grpc::": r"grpc",
    r"google::protobuf::": r"google/protobuf|palpate/v1/",
    r"v1::": r"palpate/v1/",
    r"openvdb::": r"openvdb/",
    r"Eigen::": r"Eigen/",
    r"fmt::": r"fmt/",
    r"toml::": r"toml\+\+",
    r"nlohmann::": r"nlohmann",
    r"std::filesystem|fs::": r"filesystem$",
    r"std::j?thread": r"thread$",
    r"std::mutex|std::(scoped_lock|lock_guard|unique_lock)": r"(shared_)?mutex$|condition_variable$",
    r"std::function": r"functional$",
    r"std::optional|std::nullopt": r"optional$",
    r"std::(multi)?map<": r"map$",
    r"std::(multi)?set<": r"set$",
    r"std::deque": r"deque$",
    r"std::span": r"span$",
    r"std::variant": r"variant$",
    r"std::(mt19937|\w+_distribution)": r"random$",
    r"std::[io]?stringstream": r"sstream$",
    r"std::[io]?fstream": r"fstream$",
    r"std::chrono": r"chrono$|thread$|condition_variable$|filesystem$",
    r"std::atomic": r"atomic$",
    r"std::condition_variable": r"condition_variable$",
    r"std::array<": r"array$",
    r"std::vector<": r"vector$",
    r"std::(unique|shared|weak)_ptr|std::make_(unique|shared)": r"memory$",
    r"std::numeric_limits": r"limits$",
    r"std::(clamp|sort|find_if|any_of|all_of|none_of|m(ax|in)(_element)?|transform|copy|fill|"
    r"lower_bound|upper_bound|reverse|remove_if|count_if)\(": r"algorithm$",
    r"std::(sqrt|abs|isfinite|floor|ceil|pow|sin|cos|hypot|exp|log|lround|isnan|round|fabs)\(":
        r"cmath$|cstdlib$",
    r"std::string_view": r"string(_view)?$",
    r"std::string\b": r"string$|sstream$|filesystem$",
    r"std::(runtime_error|logic_error|invalid_argument|out_of_range)": r"stdexcept$",
}

# The headers of volume that are free of OpenVDB; real-time code sees no others.
PLAIN_VOLUME_HEADERS = {"server/volume/snapshot/" + name for name in (
    "ball.h", "ball_field.h", "brick_directory.h", "brick_packer.h", "lattice.h", "snapshot.h",
    "volume_metadata.h")} | {"server/volume/edit/edit.h", "server/volume/edit/filter.h",
                             "server/volume/save/volume_export.h"}
# What programs outside of the tree include.
PUBLIC_HEADERS = ["client/sdk/client.h", "client/sdk/nrrd_file.h", "client/sdk/words.h"]

NO_OPENVDB = ["server/haptics", "server/felt", "server/pump", "server/servo", "server/device",
              "server/services", "server/recording", "server/volume_stream"]


def violations(folder, includes):
    """Reasons against these includes of a file in `folder`."""
    found = []
    for include in includes:
        parent = str(pathlib.PurePosixPath(include).parent)
        if re.match(r"(common|server|client)/", include):
            if parent not in (folder, EVERYBODYS) and parent not in LAYERS[folder]:
                found.append(f"{include}: {folder} may not use {parent}")
            if folder in NO_OPENVDB and parent.startswith("server/volume/") \
                    and include not in PLAIN_VOLUME_HEADERS:
                found.append(f"{include}: brings OpenVDB into {folder}")
        for library, (pattern, folders) in LIBRARIES.items():
            if re.match(pattern, include) and folder not in folders:
                found.append(f"{include}: {folder} may not use {library}")
    return found


def closure(header):
    """The header and all of the tree that it brings along, and their other includes."""
    own, others, waiting = set(), set(), [header]
    while waiting:
        header = waiting.pop()
        own.add(header)
        for include in includes_of(ROOT / header):
            if not (ROOT / include).is_file():
                others.add(include)
            elif include not in own:
                waiting.append(include)
    return own, others


def missing_includes(text, others):
    """What this text names though none of these headers of others declares it."""
    code = re.sub(r'//.*|"(\\.|[^"\\])*"', "", text)
    # What it declares itself needs no header: `namespace grpc { class Status; }`.
    for own in re.findall(r"namespace ([\w:]+) \{\s*class", code):
        code = re.sub(rf"\b{own}::", "", code)
    return [name for name, header in NAMES.items()
            if re.search(r"\b(" + name + ")", code)
            and not any(re.match(header, other) for other in others)]


@functools.cache
def includes_of(path):
    return re.findall(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', path.read_text(), re.MULTILINE)


class IncludeLayers(unittest.TestCase):
    def sources(self):
        for top in ("common", "server", "client"):
            for path in sorted((ROOT / top).rglob("*")):
                if path.suffix in (".h", ".cpp") and path.parent.name != "precompiled":
                    yield str(path.parent.relative_to(ROOT)), path

    def test_every_file_keeps_its_layer(self):
        count = 0
        for folder, path in self.sources():
            count += 1
            self.assertIn(folder, LAYERS, f"{folder} has no layer: add it to LAYERS")
            self.assertEqual(violations(folder, includes_of(path)), [], str(path))
        self.assertGreater(count, 50)

    def test_headers_guard_themselves(self):
        for _, path in self.sources():
            if path.suffix == ".h":
                self.assertIn("#pragma once", path.read_text(), str(path))

    def test_includes_are_complete(self):
        for _, path in self.sources():
            others = closure(str(path.relative_to(ROOT)))[1]
            self.assertEqual(missing_includes(path.read_text(), others), [], str(path))

    def test_a_missing_include_is_seen(self):
        self.assertTrue(missing_includes("std::vector<int> a;", {"string"}))
        self.assertTrue(missing_includes("grpc::Status f();", {"memory"}))
        self.assertFalse(missing_includes("grpc::Status f();", {"grpcpp/grpcpp.h"}))
        self.assertFalse(missing_includes("namespace grpc {\nclass Status;\n}\ngrpc::Status* s;", set()))
        self.assertFalse(missing_includes("// a std::vector<int>", set()))

    def test_the_public_header_is_free_of_grpc_and_is_installed_whole(self):
        closures = [closure(header) for header in PUBLIC_HEADERS]
        own = set().union(*(closed[0] for closed in closures))
        others = set().union(*(closed[1] for closed in closures))
        self.assertGreater(len(own), 8)
        for include in own | others:
            self.assertNotRegex(include, LIBRARIES["gRPC and protobuf"][0])
        for header in own:
            self.assertNotRegex((ROOT / header).read_text(), r"\b(grpc|protobuf|v1)::", header)
        installed = (ROOT / "client/sdk/install.cmake").read_text()
        listed = re.findall(r"[\w./{}$]+\.h\b", installed)
        paths = {path.replace("${PROJECT_SOURCE_DIR}/", "") if "/" in path
                 else "client/sdk/" + path for path in listed}
        contract = {str(path.relative_to(ROOT)) for path in (ROOT / "common/contract").glob("*.h")}
        self.assertIn("common/contract/*.h", installed)
        self.assertEqual(paths | contract, own | {"common/contract/recorded.h"})  # which no call carries

    def test_one_file_includes_cli11(self):
        users = [str(path.relative_to(ROOT)) for top in ("common", "server", "client", "tests")
                 for suffix in ("h", "cpp") for path in (ROOT / top).rglob("*." + suffix)
                 if any(include.startswith("CLI/") for include in includes_of(path))]
        self.assertEqual(users, ["common/arguments/arguments.cpp"])

    def test_violations_are_seen(self):
        self.assertTrue(violations("client/cli", ["CLI/CLI.hpp"]))
        self.assertTrue(violations("client/cli", ["server/felt/scene.h"]))
        self.assertTrue(violations("server/haptics", ["server/volume/snapshot/snapshot_builder.h"]))
        self.assertTrue(violations("server/servo", ["spdlog/spdlog.h"]))
        self.assertTrue(violations("server/session", ["grpcpp/grpcpp.h"]))
        self.assertTrue(violations("server/volume/load", ["gdcmImage.h"]))
        self.assertTrue(violations("server/servo", ["server/recording/recorder.h"]))
        self.assertTrue(violations("server/session", ["zstd.h"]))
        self.assertTrue(violations("server/recording", ["server/volume/snapshot/snapshot_builder.h"]))
        self.assertTrue(violations("common/isosurface", ["server/volume/snapshot/snapshot.h"]))
        self.assertFalse(violations("server/haptics", ["server/volume/snapshot/snapshot.h", "vector"]))


MOST_LINES = 600
FOR_TESTS = "Apart for its tests."


def room_of(header, users, tested, lines):
    """What a header's place should be: "" is where it is. A folder has doors, the headers that other
    folders include, and rooms, its sources. What one source alone includes is a part of that source;
    but for a test, or if both together are longer than a file may be."""
    inside = [user for user in users if user != header[:-2] + ".cpp"]
    if any(os.path.dirname(user) != os.path.dirname(header) for user in inside):
        return ""
    alone = len(inside) == 1 and inside[0].endswith(".cpp")
    if not inside and not tested:
        return "its own source"
    if (inside and not alone) or lines > MOST_LINES:
        return ""
    return "for its tests" if tested else inside[0]


class Rooms(unittest.TestCase):
    def test_a_header_that_one_source_includes_is_a_part_of_it(self):
        lines, users = {}, {}
        for top in ("common", "server", "client", "tests"):
            for path in sorted((ROOT / top).rglob("*")):
                if path.suffix not in (".h", ".cpp"):
                    continue
                name = str(path.relative_to(ROOT))
                lines[name] = path.read_text().count("\n")
                for include in includes_of(path):
                    users.setdefault(include, []).append(name)
        for header in sorted(lines):
            text = (ROOT / header).read_text()
            if header.startswith("tests/") or "/precompiled/" in header or not header.endswith(".h") \
                    or text.startswith("// Written by"):
                continue
            product = [user for user in users.get(header, []) if not user.startswith("tests/")]
            parts = {header, header[:-2] + ".cpp", *product}
            place = room_of(header, product, len(product) < len(users.get(header, [])),
                            sum(lines.get(part, 0) for part in parts))
            self.assertEqual(place, "for its tests" if FOR_TESTS in text else "", header)

    def test_a_header_in_the_wrong_place_is_seen(self):
        self.assertEqual(room_of("a/b.h", ["a/b.cpp", "a/c.cpp"], False, 90), "a/c.cpp")
        self.assertEqual(room_of("a/b.h", ["a/b.cpp"], False, 90), "its own source")
        self.assertEqual(room_of("a/b.h", ["a/b.cpp", "a/c.cpp"], True, 90), "for its tests")
        self.assertEqual(room_of("a/b.h", ["a/b.cpp", "a/c.cpp"], False, 601), "")
        self.assertEqual(room_of("a/b.h", ["a/b.cpp", "d/c.cpp"], False, 90), "")
        self.assertEqual(room_of("a/b.h", ["a/c.h"], False, 90), "")
        self.assertEqual(room_of("a/b.h", ["a/c.cpp", "a/d.cpp"], False, 90), "")

    def test_no_file_is_too_long(self):
        for top in ("common", "server", "client"):
            for path in sorted((ROOT / top).rglob("*")):
                if path.suffix in (".h", ".cpp") and not path.read_text().startswith("// Written by"):
                    self.assertLessEqual(path.read_text().count("\n"), MOST_LINES, str(path))


class Map(unittest.TestCase):
    """The maps: README.md of each top folder, and the walks in how-it-works.md."""

    def links(self, name):
        """What a document links to in the tree, in its order, by paths from the root."""
        text = (ROOT / name).read_text()
        return [os.path.normpath((ROOT / name).parent / link)
                for link in re.findall(r"\]\((?!https?:)([^)#]+)", text)]

    def test_what_is_named_exists(self):
        for name in (*MAPS, "proto/README.md", "deploy/guides/how-it-works.md",
                     "deploy/guides/contributing.md"):
            links = self.links(name)
            self.assertGreater(len(links), 8, name)
            self.assertEqual([link for link in links if not os.path.exists(link)], [], name)
            for path in re.findall(r"`((?:server|client|common|proto|tests)/[^ `]+)`",
                                   (ROOT / name).read_text()):
                self.assertTrue(any(ROOT.glob(path.rstrip("/*") + "*")), f"{name}: {path}")

    def test_every_folder_is_named_and_follows_what_it_includes(self):
        place = {}
        for name in MAPS:
            for link in self.links(name):
                place.setdefault(os.path.relpath(link, ROOT), len(place))
        self.assertEqual([folder for folder in LAYERS if folder not in place], [])
        for folder, below in LAYERS.items():
            self.assertEqual([one for one in below if place[one] > place[folder]], [], folder)


if __name__ == "__main__":
    sys.exit(unittest.main(verbosity=1))
