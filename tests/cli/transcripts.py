"""Command lines of `palpate`, and what they do. Each transcript is a test of its server's class in
transcripts_test.py; its steps are played in their order.

Words in a command line:
    $FOLDER, $SOCKET, $SERVER, $LONG   of the test
    $REVISION                          the settings_revision printed last
    PALPATE_SOCKET= in front           no socket in the environment"""

import dataclasses


@dataclasses.dataclass
class Step:
    run: str | list   # a command line, or several that do the same
    exit: int = 0     # the exit code; with any other than 0, all errors are one line ...
    error: str = ""   # ... that names this
    has: list = ()    # parts of the output
    lines: int = 0    # how many lines the output has; the first one is then the JSON
    json: dict = dataclasses.field(default_factory=dict)  # values of the JSON, by their paths
    keys: list = ()   # paths that the JSON has


NO_DAEMON = {
    "wrong_usage": [
        Step(exit=2, error="--help", run=[
            "", "touch", "info extra", "info --socket a --server b:1",
            "set", "set isovalue 1 2", "set stiffness 1 --normalized",
            "watch --rate-hz 0", "watch --rate-hz 1001", "watch --count 0", "watch --seconds -1",
            "load a --spacing-mm 1,2", "load a --spacing-mm 1,2,-3",
            "load a --isovalue 1 --normalized-isovalue 0.5", "load a --raw-size 4,4,4",
            "load a --raw-type int8", "load a --raw-size 4,4,4 --raw-type int9",
            "load a --raw-size 4,4 --raw-type int8", "load a --raw-big-endian",
            "load a --set stiffness", "load a --set stiffness=hard", "load a --set stiff=1",
            "load a --raw-size 4,4,4 --raw-type int8 --raw-offset-bytes -1", "load a --frame -1",
            "device", "device enable a b", "device push 1 2", "device push 1 2 x", "device test --seconds 0", "device test --seconds nan",
            "place --move-mm 1,2", "place --move-mm 1,2,x", "place --center-mm 1,nan,2",
            "place --scale-by 0", "place --turn-deg 90", "place --turn-deg y,ninety",
            "place --scale-by -1", "place --face=-y", "place --face=y --head=+z",
            "layer", "layer a --remove b", "layer --remove a --pop-n 1", "layer a --pop-n -1",
            "layers a=1 --load b", "place --cells-per-mm 0", "place --expected-revision 3",
            "place --cells-per-mm 2 --device-mm-per-voxel 0.5",
            "place --cells-per-mm 2 --device-mm-per-volume-mm 0.5",
            "place --device-mm-per-voxel 2 --device-mm-per-volume-mm 0.5",
        ]),
        Step("touch", exit=2, error="'touch'"),
        Step("set friction 1", exit=2, error="'friction'"),
        Step(["set stiffness x", "set stiffness_n_per_mm x"], exit=2, error="0 to 3 N/mm"),
        Step("set free_side left", exit=2, error="below or above"),
    ],
    "help": [
        Step(has=["Example"], run=[
            "--help", "info --help", "watch --help", "set --help", "set stiffness --help",
            "settings --help", "load --help", "upload --help", "download --help", "series --help",
            "series load --help", "series play --help", "series seek --help",
            "series loop --help", "series info --help", "device --help", "device list --help",
            "device info --help", "device calibrate --help", "device enable --help",
            "device disable --help", "device stop --help", "device test --help",
            "device prove --help", "who --help",
        ]),
        Step("--help", has=["Emergency stop: palpate device stop"]),
        Step("set --help", has=["--normalized", "  stiffness ", "0 to 3 N/mm", "below or above"]),
        Step("--version", has=["palpate "]),
    ],
    "no_daemon": [
        Step("info", exit=8, error="$SOCKET"),
        Step("watch --server 127.0.0.1:1", exit=8, error="127.0.0.1:1"),
        Step("info --server nonsense", exit=3, error="nonsense"),
        Step("info --socket $LONG", exit=3, error="107"),
    ],
}

# A palpated with the simulated device and a sphere of 32 voxels.
DAEMON = {
    "info": [
        Step("info", has=[
            "palpated ", " at unix:", "device    simulated", "verification level: simulated",
            "1000 Hz", " ticks, ", "32 x 32 x 32 voxels", "world x ", "orientation: unknown", "values ", "scale ",
            "isovalue ",
            "stiffness 0.5 N/mm", "method tpbcc", "off: damping",
        ]),
        Step("info --json", keys=[
            "version", "server", "caller.role", "health.connection", "forces.state",
            "servo.warnings", "servo.missed_ticks", "volume.spacing_mm.2",
            "settings.settings_revision",
        ], json={"device.verification_level": "simulated", "volume.size": [32, 32, 32]}),
    ],
    "settings": [
        Step("set isovalue 0.25", has=["isovalue 0.25 ", " tick ", "settings revision "]),
        Step("set stiffness 0.75 --json", json={"isovalue": 0.25, "stiffness_n_per_mm": 0.75},
             keys=["applied_tick", "settings_revision", "receipt_to_applied_ns"]),
        Step("set --json force_shading on", json={"isovalue": 0.25, "force_shading": True}),
        Step("set free_side above --json", json={"free_side": "above"}),
        Step("set method bcc --json", json={"method": "bcc"}),
        Step("settings --json", json={"isovalue": 0.25, "free_side": "above", "method": "bcc"}),
        Step("set isovalue otsu --json", json={"isovalue": 11.5}),
        Step("info", has=["histogram ", "otsu 11.5"]),
        Step("set isovalue bone", exit=3, error="otsu"),
        Step("set stifness 1", exit=2, error="'stiffness'"),
        Step(["set isovalue --normalized 0.5 --json", "set isovalue 0.5 --normalized --json"],
             json={"normalized_isovalue": 0.5}),
    ],
    "layers": [
        Step("set free_side below"),
        Step("layers", has=["no layers"]),
        Step("layers skin=0.2,bone=0.9 --json", json={
            "layer.0.name": "skin", "layer.0.pop_force_n": 1, "layer.1.pop_force_n": 0}),
        Step("layer fat --isovalue 0.5 --pop-n 0.5 --viscosity 1 --json", json={
            "layer.0.id": 1, "layer.1.name": "fat", "layer.1.id": 3, "layer.2.id": 2}),
        Step("layer fat --pop-out-n 0.2", has=["3 fat: isovalue 0.5", "outwards 0.2 N", " tick "]),
        Step(["set isovalue 0.4", "set stiffness 1", "set free_side above"], exit=3,
             error="palpate layer"),
        Step("layer muscle --pop-n 1", exit=4, error="--isovalue"),
        Step("layer --remove muscle", exit=4, error="fat"),
        Step("layer --remove fat --json", json={"layer.1.name": "bone"}),
        Step("settings", has=["layer 1 skin"]),
        Step("layer --remove all", has=["no layers"]),
    ],
    "ball": [
        Step("set tool_radius 5", has=["tool_radius 5 mm applied at tick"]),
        Step("settings --json", json={"tool_radius_mm": 5, "ball.felt_radius_mm": 5}),
        # Where the ball cannot be, a point is felt, from any side.
        Step("place --scale-by 0.01"),
        Step("settings", has=["the ball of the settings is not felt"]),
        Step("set free_side above", has=["free_side above applied"]),
        Step("set free_side below"),
        Step("place --scale-by 100"),
        Step("set tool_radius 0.01", exit=3, error="0.3 to 8 voxels"),
        Step("set tool_radius 21", exit=3, error="0 to 20 mm"),
        Step("set tool_radius 0", has=["applied at tick"]),
        Step("settings --json", json={"ball.felt_radius_mm": 0}),
    ],
    "tool": [
        Step("load builtin:bumps:64 --discard"),
        Step("set free_side below"),
        Step("set dynamic_friction 0"),
        Step("set force_shading off"),
        Step("set pop_force 0"),
        Step("tool load drill", has=["drill: 39 balls", "in the volume"]),
        Step("tool", has=["1 carves"]),
        # What forbids what, with the command that ends it.
        Step("layers a=0.2,b=0.9", exit=10, error="palpate tool none"),
        Step("set dynamic_friction 1", exit=10, error="palpate tool none"),
        Step("set tool_radius 5", has=["waits"]),
        Step("place --scale-by 0.01", has=["palpate tool load drill --scale 0."]),
        Step("tool", has=["not felt", "palpate place --scale-by "]),
        Step("place --scale-by 100"),
        Step("tool none", has=["a ball of 5 mm"]),
        Step("set tool_radius 0"),
        Step("tool load drill --scale 20", exit=3, error="palpate tool load drill --scale "),
        Step("layers a=0.2,b=0.9"),
        Step("set pop_force 1", exit=3, error="palpate layer --remove all"),
        Step("tool load drill", exit=10, error="palpate layer --remove all"),
        Step("layer --remove all"),
        Step("set force_shading on"),
        Step("tool load drill", exit=10, error="palpate set force_shading off"),
        Step("set force_shading off"),
        Step("tool load drill", has=["39 balls"]),
        Step("tool none", has=["no tool"]),
        Step("tool load hammer", exit=4, error="probe"),
    ],
    "refusals": [
        Step(["set stiffness 99", "set stiffness_n_per_mm -.5"], exit=3, error="stiffness"),
        # Negative numbers are values, too: the daemon refuses them for this volume.
        Step(["set isovalue -200", "set isovalue -2e2 --json"], exit=3, error="isovalue -200 "),
        Step(["set isovalue -.5", "set isovalue -0.5"], exit=3, error="isovalue -0.5 "),
        Step("settings --json"),
        Step("set isovalue 0.4 --expected-revision $REVISION --json", json={"isovalue": 0.4}),
        Step("set --expected-revision 0 isovalue 0.4", exit=7, error="$REVISION"),
        Step("load /absent.nrrd", exit=4, error="/absent.nrrd"),
    ],
    "servers": [
        Step(has=["settings  revision "], run=[
            "PALPATE_SOCKET= --socket $SOCKET settings",
            "PALPATE_SOCKET= settings --socket $SOCKET",
            "PALPATE_SOCKET= settings --server $SERVER",
        ]),
        Step("PALPATE_SOCKET= watch --count 3 --json --server $SERVER", lines=3),
    ],
    "watch": [
        Step("watch --json --rate-hz 500 --count 23", lines=23, keys=[
            "tick", "hip_mm.2", "stylus_orientation.3"]),
        Step("watch --count 40", has=["samples         40,"]),
    ],
    "device": [
        Step("device list --json", keys=["devices.0.usable", "devices.0.problem"],
             json={"devices.0.kind": "simulated", "devices.0.in_use": True}),
        Step("device info", has=["device    simulated", "streaming", "forces  ", "force at most "]),
        Step("device info --json", keys=["device.verification_level", "forces.limit_n"],
             json={"health.connection": "streaming"}),
        Step("device calibrate", exit=3, error="`simulated`"),
    ],
    "forces": [
        Step("device disable --json", json={"reason": "operator"}, keys=["applied_tick"]),
        Step(["device enable --json", "device enable simulated --json"], json={"reason": "none"},
             keys=["state", "limit_n", "applied_tick"]),
        Step("device enable other", exit=3, error="simulated"),
        Step("device stop", has=["forces    stopped: ", "since tick "]),
        Step("device stop --json", json={"state": "stopped", "reason": "stop-call"}),
        Step("device info", has=["set by local socket"]),
        Step("info --json", keys=["forces.set_by"]),
        Step("who", has=["local socket (you)", "forces "]),
        Step("who --json", keys=["callers.0.peer", "callers.0.connected_s", "changes.0.ago_s"],
             json={"callers.0.is_you": True, "changes.0.what": "forces",
                   "changes.0.by": "local socket"}),
        Step("device push 0 0.3 0", exit=10, error="emergency stop"),
        Step("device enable", has=["forces    ", "since tick "]),
        Step("device push 0 -0.3 0", has=["pushes since tick "]),
        Step("device push 0 0.3 0 --seconds 0.1 --json", keys=["applied_tick"]),
        Step("device push 0 0.6 0", exit=3, error="0.5 N"),
    ],
    "load": [
        Step("load builtin:sphere:16 --isovalue 0.125 --spacing-mm 1,2,3.5", has=[
            "16 x 16 x 16 voxels of 1 x 2 x 3.5 mm", "applied at tick ", "settings revision ",
        ]),
        Step("settings --json", json={"isovalue": 0.125}),
        Step("load --set isovalue=0.25 --set stiffness=0.7 --set force_shading=on builtin:sphere:16"),
        Step("settings --json", json={"isovalue": 0.25, "stiffness_n_per_mm": 0.7,
                                      "force_shading": True}),
        Step(exit=3, run=["load builtin:sphere:16 --set stiffness=99",
                          "load builtin:sphere:16 --set isovalue=0.5 --isovalue 0.5"]),
        Step("load $FOLDER/two.nrrd --normalized-isovalue 0 --frame 1",
             has=["2 x 3 x 4 voxels", "values 10 to 33"]),
        Step("settings --json", json={"isovalue": 10, "normalized_isovalue": 0}),
        Step("load two.nrrd --frame 2", exit=3, error="frame"),
        Step("load two.nrrd --device-mm-per-volume-mm 0.25", has=["scale 0.25 mm"]),
        Step("load big.raw --raw-size 2,3,4 --raw-type uint16 --raw-big-endian "
             "--raw-offset-bytes 6", has=["2 x 3 x 4 voxels", "values 0 to 23"]),
    ],
}

# A palpated whose volumes are edited, saved, sent, played and placed; uploads of 1 MiB at most.
SPHERE = "edit sphere --center-voxels 9,9,9 "
BLOCK = "edit block absent.f32 --operation set --size-voxels 2,2,2 --min-voxels "
VOLUMES = {
    "edits": [
        Step("load builtin:bumps:64 --discard"),
        Step("edit box --min-voxels 10,10,10 --max-voxels 12,12,12 --operation set --value 0.75 "
             "--json", json={"changed_voxels": 27, "changed.max": [12, 12, 12]}),
        Step("edit capsule --from-mm -1,2,3 --to-mm 9,2,3 --radius-mm 2 --falloff-mm 1 "
             "--operation paint --value 1 --strength .5"),
        Step("undo --json", json={"redo_steps": 1}),
        Step("redo --json", json={"undo_steps": 2}),
        Step("undo --expected-revision 1", exit=7),
        Step("revert"),
        Step("edit block block.f32 --min-voxels 1,2,3 --size-voxels 2,2,2 --operation set --json",
             json={"changed.min": [1, 2, 3]}),
        Step("save a.nrrd --json", keys=["size_bytes"]),
        Step("save a.nrrd", exit=7),
        Step("save a.nrrd --overwrite"),
    ],
    "edits_that_make_no_sense": [
        Step("load builtin:bumps:64 --discard"),
        Step(SPHERE + "--radius-voxels 2 --operation set --value 0.5"),
        Step(exit=2, run=[
            "edit", BLOCK + "-1,1,1", SPHERE + "--radius-mm 2 --operation set --value 0.5",
            SPHERE + "--operation set --value 0.5", *(SPHERE + "--radius-voxels " + end for end in (
                "2 --operation set", "2 --value 0.5", "2 --operation cut --value 0.5",
                "2 --operation smooth --value 0.5", "nan --operation smooth",
                "2 --operation smooth --strength 2")),
        ]),
        Step(SPHERE + "--radius-voxels -2 --operation smooth", exit=3),
        Step(BLOCK + "1,1,1", exit=4),
    ],
    "downloads": [
        Step("load builtin:bumps:64 --discard"),
        Step(["download copy.nrrd", "download copy.vdb"], has=[
            "64 x 64 x 64 voxels of builtin:bumps:64 at volume revision", "MB received"]),
        Step(["download copy.nrrd", "download copy.vdb"], exit=7),
        Step(["download missing/copy.nrrd", "download missing/copy.vdb"], exit=4),
        Step(["download copy", "download copy.nii", "download .vdb", "download copy.vdb.gz",
              "download $FOLDER"], exit=3, error=".nrrd or .vdb"),
        Step(["download copy.nrrd --overwrite", "download copy.vdb --overwrite",
              "download COPY.VDB"]),
    ],
    "uploads": [
        Step("upload sent.nrrd --normalized-isovalue 0.25 --discard"),
        Step("info --json", json={"volume.source": "upload:sent.nrrd"}),
        Step("upload", exit=2),
        Step("upload absent.nrrd", exit=4),
        Step("upload empty.nrrd", exit=3),
        Step(["upload large.nrrd", "upload $FOLDER"], exit=6),
        Step("upload b.dat --raw-size 4,4,3 --raw-type uint8"),
        Step("info --json", json={"volume.size": [4, 4, 3]}),
    ],
    "series": [
        Step("series load $FOLDER/t*.nrrd --discard", has=["applied at tick "]),
        Step("series seek 2 --json", json={"position_frames": 2}, keys=["applied_tick"]),
        Step(["series rate -.5", "series loop on", "series interpolate on", "series seek 1.5",
              "series play"]),
        Step("series info --json", json={"frames": 3, "playing": True, "rate_hz": -0.5,
                                         "loop": True, "interpolate": True}),
        Step("series pause"),
        Step("series info --json", json={"playing": False}),
        Step("series seek 7", exit=3),
        Step(exit=2, run=["series", *(f"series {line}" for line in (
            "load", "seek", "seek x", "rate", "loop", "loop maybe", "play x", "stop"))]),
        Step("load builtin:sphere:16"),
        Step("series info", exit=7),
    ],
    "place": [
        Step("load builtin:bumps:32 --discard"),
        Step("place --center-mm -.5,1,0 --turn-deg z,-90 --cells-per-mm 4 --json",
             keys=["applied_tick"], json={"center_mm": [-0.5, 1, 0], "device_mm_per_voxel": 0.25}),
        Step("place", has=["turned by 90° about (0, 0, -1)"]),
        Step("place --device-mm-per-voxel 1e7", exit=3),
        Step("place --reset --expected-revision 1", exit=7),
        Step("place --reset --expected-revision $REVISION"),
        Step("place --json", json={"center_mm": [0, 0, 0]}),
        Step("place --face=-y --head=-y", exit=3, error="face"),
        Step("place --face=+y --head=+z --json", keys=["applied_tick"]),
        Step("info", has=["orientation: RAS, as somebody answered"]),
        Step([f"edit sphere --center-patient '{place}' --radius-mm 2 --operation set --value {value} "
              "--json" for place, value in (("R 3 A 5 S 7 mm", 0.5), ("A 5 S 7 L -3", 0.6))],
             json={"changed.min": [1, 3, 5], "changed.max": [5, 7, 9]}),
        Step([f"edit sphere --center-patient '{place}' --radius-mm 2 --operation smooth"
              for place in ("R 3 L 5 S 7", "R 3 A 5", "R 3 A x S 7", "R 3 A 5 S 7 S")], exit=2),
        Step("edit sphere --center-patient 'R 900 A 5 S 7' --radius-mm 2 --operation smooth", exit=3,
             error="x 0 to 31"),
        Step("load builtin:bumps:16 --discard"),
        Step("edit sphere --center-patient 'R 3 A 5 S 7' --radius-mm 2 --operation smooth", exit=10,
             error="palpate place --face"),
    ],
}

# A palpated whose device is not plugged in.
NO_DEVICE = {
    "device": [
        Step("device info --json", keys=["health.problem"],
             json={"health.connection": "absent", "device.kind": "falcon"}),
        Step("device enable", exit=3, error="falcon"),
        Step("device enable falcon", exit=10),
        Step("device prove --forces omni-usb", exit=3, error="find: "),
        Step("device prove --out proof", exit=10, error="find: ", has=["proposed level: none"]),
        Step("device prove --out proof", exit=7, error="proof"),
        Step("device test --seconds 1 --json", exit=1, error="not streaming",
             json={"passed": False}),
    ],
}

# A server that has one of palpated's services.
OTHER_SERVICE = {
    "other_service": [
        Step(["settings", "watch --json"], exit=8, error="palpated"),
    ],
}
