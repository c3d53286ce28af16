"""Settings as attributes, and what the server says against them."""

import dataclasses
import unittest

import numpy as np
from google.protobuf import descriptor_pool

import palpate
from palpate import _word
from palpate.v1 import render_pb2, setting_pb2
from support import DaemonTest, wait_until


def another(field):
    """A value of a setting that is not its default, by the list that is in the contract."""
    says = field.GetOptions().Extensions[setting_pb2.setting]
    if says.whole:
        return says.maximum
    if field.type == field.TYPE_DOUBLE:
        return says.minimum + 0.25 * (says.maximum - says.minimum)
    if field.type == field.TYPE_BOOL:
        return not says.default_flag
    return next(value.number for value in reversed(field.enum_type.values)
                if not value.name.endswith("_" + says.default_choice.upper()))


class SettingsTest(DaemonTest):
    def test_every_setting_goes_there_and_comes_back(self):
        fields = render_pb2.RenderSettings.DESCRIPTOR.fields
        values = {field.name: another(field) for field in fields if field.name not in ("layers", "tool")}
        values["isovalue"] = 0.25
        self.assertEqual(sorted(self.conn.settings.all()), sorted([*values, "layers", "tool"]))
        self.assertEqual(values["carve_rate_per_s"], -10.0)
        before = self.conn.settings.all()
        with self.daemon.connect() as other:
            for name, value in values.items():
                setattr(self.conn.settings, name, value)
                self.assertEqual(getattr(other.settings, name), value, name)
        before.pop("normalized_isovalue")
        self.conn.settings.update(**before)
        self.assertEqual({name: self.conn.settings.all()[name] for name in before}, before)

    def test_several_at_one_tick(self):
        with self.conn.poses(1000, 10, waiting=1000) as stream:
            next(stream)
            applied = self.conn.settings.update(isovalue=0.3, stiffness_n_per_mm=1.0)
            for poses in stream:
                if poses.tick[-1] >= applied.applied_tick:
                    break
        at = np.flatnonzero(poses.tick >= applied.applied_tick)[0]
        self.assertGreaterEqual(poses.settings_revision[at], applied.settings_revision)
        # Under a stylus that touches, the isovalue moves from there on.
        self.assertTrue(0.3 <= poses.isovalue[at] < 0.5)
        with self.conn.poses(200) as stream:
            self.assertTrue(wait_until(lambda: next(stream).isovalue[-1] == 0.3))
        self.conn.settings.update(isovalue=0.5, stiffness_n_per_mm=0.5)

    def test_layers_go_there_and_come_back_in_order(self):
        settings = self.conn.settings
        self.assertEqual(settings.layers, ())
        self.addCleanup(settings.update, layers=[], isovalue=0.5)
        settings.layers = [palpate.Layer("bone", 0.6, 1.5), palpate.Layer(
            "skin", 0.4, 0.3, pop_force_n=1.0, pop_out_force_n=0.5, viscosity_n_s_per_m=2.0)]
        skin, bone = settings.layers
        self.assertEqual(skin, palpate.Layer("skin", 0.4, 0.3, pop_force_n=1.0, pop_out_force_n=0.5,
                                             viscosity_n_s_per_m=2.0, id=1))
        self.assertEqual(bone, palpate.Layer("bone", 0.6, 1.5, id=2))
        # Read back, one changed: ids stay.
        settings.layers = [dataclasses.replace(skin, isovalue=0.7), bone]
        self.assertEqual([(layer.name, layer.id) for layer in settings.layers],
                         [("bone", 2), ("skin", 1)])
        # What they replace is refused, and says where to look.
        for name, value in (("isovalue", 0.5), ("stiffness_n_per_mm", 1.0), ("free_side", "above")):
            with self.assertRaisesRegex(palpate.InvalidArgument, "remove the"):
                setattr(settings, name, value)
        before = settings.all()
        close = palpate.Layer("close", bone.isovalue + 9e-7)
        for wrong in ([palpate.Layer("far", 5.0)], [palpate.Layer("", 0.5)], [bone, close],
                      [palpate.Layer(f"{n}", 0.1 * n) for n in range(9)], [skin, skin],
                      [palpate.Layer("soft", 0.5, -1.0)], ["skin"], 3, [palpate.Layer("a", "b")],
                      [palpate.Layer("nan", float("nan"))], [palpate.Layer("x", 0.5, id=9)]):
            with self.assertRaises(palpate.InvalidArgument):
                settings.layers = wrong
        self.assertEqual(settings.all(), before)

    def test_a_ball_is_waited_for(self):
        settings = self.conn.settings
        self.addCleanup(settings.update, tool_radius_mm=0.0)
        settings.tool_radius_mm = 6.0
        self.assertEqual(settings.wait_for_ball(), 6.0)
        self.assertEqual(settings.ball(), palpate.BallState(6.0, False, None, ""))
        with self.conn.poses(100) as stream:
            self.assertTrue(wait_until(lambda: next(stream).tool_radius_mm[-1] == 6.0))
        with self.assertRaisesRegex(palpate.InvalidArgument, "voxels"):
            settings.tool_radius_mm = 0.01
        settings.tool_radius_mm = 0.0
        self.assertEqual(settings.wait_for_ball(timeout_s=5.0), 0.0)

    def test_a_tool_goes_there_and_comes_back(self):
        settings = self.conn.settings
        self.assertIsNone(settings.tool)
        self.addCleanup(setattr, settings, "tool", None)
        path = self.daemon.folder / "tool.toml"
        path.write_text('name = "drill"\nrotation_length_mm = 40\n'
                        '[[ball]]\ncenter_mm = [0, 0, 0]\nradius_mm = 6\ncarves = true\n'
                        '[[line]]\nfrom_mm = [0, 0, 8]\nto_mm = [0, 0, 12]\ncount = 3\n')
        drill = palpate.Tool.read(path)
        self.assertEqual(drill, palpate.Tool(
            (palpate.ToolBall((0.0, 0.0, 0.0), 6, True), palpate.ToolBall((0.0, 0.0, 8.0)),
             palpate.ToolBall((0.0, 0.0, 10.0)), palpate.ToolBall((0.0, 0.0, 12.0))), "drill", 40))
        settings.tool = drill
        settings.wait_for_tool()
        self.assertEqual(settings.tool, drill)
        with self.conn.poses(100) as stream:
            self.assertTrue(wait_until(lambda: np.isfinite(next(stream).tool_orientation[-1, 0])))
        ours = palpate.Tool.read("drill")
        self.assertEqual((len(ours.balls), ours.balls[0].radius_mm), (39, 3.0))
        half = ours.scaled(0.5)
        self.assertEqual((half.balls[0].radius_mm, half.balls[-1].center_mm, half.rotation_length_mm),
                         (1.5, (0.0, 0.0, 30.0), 15.0))
        with self.assertRaisesRegex(palpate.InvalidArgument, "probe"):
            palpate.Tool.read("hammer")
        before = settings.all()
        for wrong in ("drill", palpate.Tool((palpate.ToolBall((0.0, 0.0)),)),
                      palpate.Tool((palpate.ToolBall((0.0, 0.0, 0.0), -1.0),)),
                      palpate.Tool(drill.balls * 20)):
            with self.assertRaises(palpate.InvalidArgument):
                settings.tool = wrong
        with self.assertRaisesRegex(palpate.FailedPrecondition, "tool"):
            settings.pop_force_n = 1.0
        self.assertEqual(settings.all(), before)
        for bad in ("center_mm = 3", "[[ball]]\nradius_mm = 1", "[[line]]\nfrom_mm = [0, 0, 0]"):
            path.write_text(bad)
            with self.assertRaises(palpate.InvalidArgument):
                palpate.Tool.read(path)
        settings.tool = None
        with self.conn.poses(100) as stream:
            self.assertTrue(wait_until(lambda: np.isnan(next(stream).tool_orientation[-1, 0])))

    def test_names_and_numpy_numbers_will_do(self):
        self.conn.settings.free_side = "above"
        self.assertIs(self.conn.settings.free_side, palpate.FreeSide.ABOVE)
        self.conn.settings.free_side = palpate.FreeSide.BELOW
        self.conn.settings.isovalue = np.float32(0.5)
        self.conn.settings.force_shading = np.bool_(False)

    def test_a_choice_reads_as_the_word_that_sets_it(self):
        settings = self.conn.settings
        before = settings.method
        for word in ("bcc", "tpbcc"):
            settings.method = word
            self.assertEqual(settings.method, word)
            self.assertEqual((str(settings.method), f"{settings.method:>20}"),
                             (word, f"{word:>20}"))
            self.assertFalse(settings.method != word)
            # What was read sets it too, as the word that was printed does.
            settings.method = settings.method
            settings.method = f"{settings.method}"
            self.assertEqual(settings.all()["method"], word)
        settings.method = "BCC"
        self.assertIs(settings.method, palpate.DecompositionMethod.BCC)
        self.assertEqual((int(settings.method), settings.method), (1, 1))
        settings.method = before
        with self.assertRaisesRegex(palpate.InvalidArgument,
                                    "one of bcc, tpbcc, not 'cubes'"):
            settings.method = "cubes"

    def test_members_compare_with_arrays_and_numbers(self):
        sides = np.array([1, 2, 2], dtype=np.uint8)
        np.testing.assert_array_equal(sides == palpate.FreeSide.ABOVE, [False, True, True])
        np.testing.assert_array_equal(palpate.FreeSide.ABOVE != sides, [True, False, False])
        self.assertTrue(sides[1] == palpate.FreeSide.ABOVE == sides[2])
        self.assertEqual({palpate.FreeSide.ABOVE: "above"}[2], "above")

    def test_an_unknown_setting_is_an_attribute_error(self):
        with self.assertRaises(AttributeError):
            self.conn.settings.isovalu = 0.3
        with self.assertRaises(AttributeError):
            self.conn.settings.isovalu
        with self.assertRaises(AttributeError):
            self.conn.settings.update(isovalu=0.3)
        with self.assertRaises(AttributeError):
            self.conn.settings = 0.3

    def test_what_is_refused_changes_nothing(self):
        before = self.conn.settings.all()
        refused = ({"stiffness_n_per_mm": 99.0}, {"isovalue": 1e9}, {"isovalue": float("nan")},
                   {"isovalue": 0.4, "stiffness_n_per_mm": 99.0}, {"isovalue": "high"},
                   {"isovalue": None}, {"carve_tool": "off"}, {"carve_tool": 1},
                   {"free_side": "left"}, {"method": 0}, {"isovalue": True},
                   {"isovalue": np.bool_(True)}, {"isovalue": 10**400}, {"method": True},
                   {"method": ""}, {"free_side": None}, {"refinement": 2.5}, {})
        for changes in refused:
            with self.assertRaises(palpate.InvalidArgument, msg=str(changes)) as caught:
                self.conn.settings.update(**changes)
            self.assertNotIn("\n", str(caught.exception))
            self.assertGreater(len(str(caught.exception)), 10)
        self.assertEqual(self.conn.settings.all(), before)
        with self.assertRaises(ValueError):
            self.conn.settings.isovalue = -5.0
        with self.assertRaises(palpate.Conflict):
            self.conn.settings.update(isovalue=0.4, expected_revision=1 << 40)
        for revision in (-1, "3", True, 1.5):
            with self.assertRaises(palpate.InvalidArgument):
                self.conn.settings.update(isovalue=0.4, expected_revision=revision)

    def test_the_enumerations_are_the_contracts(self):
        pool = descriptor_pool.Default()
        for kind in _word.Word.__subclasses__():
            theirs = pool.FindEnumTypeByName(f"palpate.v1.{kind.__name__}").values
            self.assertEqual([int(one) for one in kind], [value.number for value in theirs[1:]])
            for one, value in zip(kind, theirs[1:]):
                self.assertTrue(value.name.endswith("_" + one.name), value.name)


if __name__ == "__main__":
    unittest.main()
