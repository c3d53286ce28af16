"""A recording that changes all that viewers are shown, and replays of it that stand still."""

import contextlib
import threading

import numpy as np

import palpate
from support import PATIENCE_S, wait_until

TOOL = palpate.Tool((palpate.ToolBall((0, 0, 0), 2.0, True), palpate.ToolBall((0, 0, 6), 1.0)),
                    "test drill")
LAYERS = (palpate.Layer("skin", 0.35, 0.3, pop_force_n=1.0), palpate.Layer("bone", 0.6))


def record(conn, path, ticks=60):
    """Returns the recording, as the package reads it. Afterwards all is otherwise."""
    def hold():
        end = conn.recording.state().ticks + ticks
        assert wait_until(lambda: conn.recording.state().ticks >= end)

    conn.recording.start(path)
    for change in ({"isovalue": 0.3}, {"tool_radius_mm": 2.0}, {"stiffness_n_per_mm": 0.2},
                   {"tool_radius_mm": 0.0, "isovalue": 0.45}, {"free_side": "above"},
                   {"free_side": "below", "layers": LAYERS}, {"layers": LAYERS[:1]},
                   {"layers": (), "tool": TOOL}, {"damping_n_s_per_m": 1.0},
                   {"tool": None, "refinement": 2}):
        conn.settings.update(**change)
        conn.settings.wait_for_ball()
        hold()
        if len(change) == 1:
            conn.volume.place(move_mm=(1.5, 0, 0), turn_deg=("y", 7))
        else:
            conn.edit.sphere((4.0, 0.0, 0.0), 3.0, "set", 0.4)
        hold()
    conn.recording.stop()
    conn.edit.revert()
    conn.volume.place(reset=True)
    conn.settings.update(isovalue=0.7, refinement=1, damping_n_s_per_m=0.0,
                         layers=(palpate.Layer("live", 0.65),))
    return palpate.open_recording(path)


def scene_at(recording, place):
    """The scene of the tick that has this place in the recording."""
    return recording.scene_at(recording.ticks.tick[place])


@contextlib.contextmanager
def standing(daemon, path, place):
    """A replay by another client that stands still at this place. Yields the pose that is shown."""
    stop = threading.Event()

    def replay():
        with daemon.connect() as other:
            while not stop.is_set():
                # Conflict: the replay before is ending.
                with contextlib.suppress(palpate.Cancelled, palpate.Conflict):
                    other.recording.replay(path, 1e-6, first_tick=place,
                                           progress=lambda _: not stop.is_set())
    thread = threading.Thread(target=replay)
    thread.start()
    try:
        with daemon.connect() as conn, conn.poses() as stream:
            assert wait_until(lambda: next(stream).replayed[-1])
            yield next(stream)
    finally:
        stop.set()
        thread.join(PATIENCE_S)
        with daemon.connect() as conn:
            assert wait_until(lambda: conn.recording.state().replay is None)


def differences(scene, settings, device_from_index):
    """What of the settings, by name, and of the place is not the scene's. The normalised isovalue of
    a scene is that of its surface."""
    names = set(scene.settings) - {"normalized_isovalue"}
    return [name for name in names if settings[name] != scene.settings[name]] + (
        [] if np.array_equal(device_from_index, scene.device_from_index) else ["place"])
