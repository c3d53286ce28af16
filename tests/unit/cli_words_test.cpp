// What the command line reads and says: settings, places, volumes, paths.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>

#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/cli/place_command.h"
#include "client/cli/reach.h"
#include "client/cli/record_command.h"
#include "client/cli/set_command.h"
#include "client/cli/setting.h"
#include "client/sdk/messages.h"
#include "common/error/text.h"
#include "common/felt_tool/tool_file.h"
#include "common/felt_tool/tool_size.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"
#include "tests/support/places.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate::cli {
namespace {

using client::kSettings;

// As a daemon with these settings tells them.
client::Settings Told(const v1::RenderSettings& settings) { return client::FromProto(settings, 3); }

client::Settings Told(const client::SettingsUpdate& update) {
  return Told(client::ToProto(update).settings());
}

TEST(Tools, AreReadAsTheyAreWritten) {
  const HeldTool tool = ParseTool(R"(
name = "hook"
rotation_length_mm = 12.5
[[ball]]
center_mm = [1, 2.5, -3]
radius_mm = 2
carves = true
[[line]]
from_mm = [0, 0, 4]
to_mm = [0, 0, 10]
count = 3
)",
                                  "hook.toml");
  const HeldTool expected{
      .name = "hook",
      .ball = {{Vec3(1, 2.5, -3), 2.0, true}, {Vec3(0, 0, 4)}, {Vec3(0, 0, 7)}, {Vec3(0, 0, 10)}},
      .rotation_length_mm = 12.5};
  EXPECT_EQ(tool, expected);
  EXPECT_EQ(ToolFromToml(ToolToToml(tool)), tool);
  for (const auto& [name, balls] : {std::pair("probe", 64u), {"drill", 39u}, {"endoscope", 63u}}) {
    EXPECT_EQ(ReadTool(name).ball.size(), balls);
  }
}

TEST(Tools, WhatIsNoneIsRefusedWithItsLine) {
  const std::map<std::string, std::string> lines = {
      {"name = 3", "line 1"},
      {"[[ball]]\ncenter_mm = [1, 2]", "line 1"},
      {"[[ball]]\ncenter_mm = [1, 2, \"3\"]", "line 2"},
      {"[[ball]]\ncenter_mm = [1, 2, 3]\nradius = 3", "line 3"},
      {"[[ball]]\ncenter_mm = [1, 2, 3]\ncarves = 1", "line 3"},
      {"[ball]\ncenter_mm = [1, 2, 3]", "line 1"},
      {"[[line]]\nfrom_mm = [0, 0, 0]\nto_mm = [1, 1, 1]\ncount = 1", "line 1"},
      {"[[line]]\nfrom_mm = [0, 0, 0]\nto_mm = [1, 1, 1]\ncount = 2000000000", "line 1"},
      {"name = \"x\"\n[[", "line 2"},
      {"name = \"without balls\"", "x.toml"}};
  for (const auto& [text, line] : lines) {
    const std::string refusal =
        testing::Complaint([&, &text = text] { ParseTool(text, "x.toml"); });
    EXPECT_NE(refusal.find(line), std::string::npos) << text << ": " << refusal;
    EXPECT_NE(refusal.find("x.toml"), std::string::npos) << refusal;
  }
}

// The scale makes the greatest and the least ball fit, and can be typed.
TEST(Tools, FitAtTheScaleNextToOne) {
  const HeldTool drill = ReadTool("drill");  // 1.5 and 3 mm
  for (const double voxel_mm : {0.02, 0.1, 0.374999, 0.375, 1.0, 5.0, 5.1, 20.0}) {
    const auto scale = FittingScale(drill, voxel_mm);
    const auto magnification = FittingMagnification(drill, voxel_mm);
    ASSERT_TRUE(scale && magnification) << voxel_mm;
    const bool fits = voxel_mm >= 0.375 && voxel_mm <= 5.0;
    EXPECT_EQ(*scale == 1.0, fits) << voxel_mm;
    EXPECT_EQ(*magnification == 1.0, fits) << voxel_mm;
    for (const double voxels : {*scale / voxel_mm, 1.0 / (*magnification * voxel_mm)}) {
      EXPECT_LE(3.0 * voxels, kMostBallVoxels) << voxel_mm;
      EXPECT_GE(1.5 * voxels, kLeastBallVoxels) << voxel_mm;
    }
    EXPECT_EQ(FittingScale(Scaled(drill, std::stod(fmt::format("{:g}", *scale))), voxel_mm), 1.0);
  }
  EXPECT_FALSE(FittingScale({.ball = {{.radius_mm = 0.1}, {.radius_mm = 5.0}}}, 1.0));
  EXPECT_EQ(FittingScale({.ball = {{}}}, 1.0), 1.0);  // a point
}

TEST(Progress, InAPipeIsALineEveryTwoSeconds) {
  ProgressPrinter::Clock::time_point now{};
  ::testing::internal::CaptureStderr();
  {
    ProgressPrinter printer([&] { return now; });
    for (int tenth = 0; tenth <= 50; ++tenth) {
      printer.Print("reading", 0.02 * tenth);
      now += std::chrono::milliseconds(100);
    }
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), " 40 % reading\n 80 % reading\n");
}

TEST(ReplayWords, SayWhoReplaysWhatAndThatForcesAreOff) {
  EXPECT_EQ(DescribeReplay({}), "shows     live\n");
  const client::RunningReplay replay{"token ada", "/data/trial\n7.mcap", 61'000, 72'500, 0.25};
  const std::string text = DescribeReplay(replay);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 2) << text;
  for (const char* part :
       {"token ada", "7.mcap", ": forces are off", "61.000 s", "72.500 s", "0.25"}) {
    EXPECT_NE(text.find(part), text.npos) << text;
  }
  EXPECT_EQ(text.find("/data"), text.npos) << text;
}

TEST(VolumeWords, TheBoxInTheWorldHoldsAllVoxels) {
  client::VolumeInfo volume;
  volume.size = Vec3i(3, 5, 2);
  volume.world_from_index.linear.diagonal() = Vec3(-2.0, 1.0, 10.0);
  volume.world_from_index.translation = Vec3(100.0, -8.0, 0.5);
  const std::string text = Describe(volume);
  EXPECT_NE(text.find("x 96 to 100, y -8 to -4, z 0.5 to 10.5 mm, centre 98,-6,5.5"), text.npos)
      << text;
}

TEST(CliSetting, NamesOfValuesAreTheDaemons) {
  client::SettingsUpdate update;
  const auto takes_all = [&update](std::string_view key, const auto& names) {
    const Setting& setting = *FindSetting(key);
    EXPECT_EQ(WordsOf(setting).size(), names.size());
    for (const std::string_view name : names) {
      EXPECT_TRUE(StoreSetting(setting, std::string(name), update)) << name;
      EXPECT_EQ(SettingJson(setting, Told(update)), std::string(name));
      EXPECT_NE(ValuesOf(setting).find(name), std::string::npos) << name;
    }
  };
  takes_all("method", kWords<DecompositionMethod>);
  EXPECT_EQ(update.method, DecompositionMethod::kTpbcc);
  takes_all("free_side", kWords<FreeSide>);
  EXPECT_EQ(update.free_side, client::FreeSide::kAbove);
}

TEST(CliSetting, NumbersFlagsAndNamesAreTold) {
  for (const auto& [name, value, told] : std::vector<std::array<std::string, 3>>{
           {"pop_force", "2.50", "pop_force 2.5 N"},
           {"damping", "1e-3", "damping 0.001 N·s/m"},
           {"static_friction", "-0.5", "static_friction -0.5"},  // the daemon's to refuse
           {"force_shading", "true", "force_shading on"},
           {"passivity_control", "off", "passivity_control off"},
           {"free_side", "above", "free_side above"},
           {"method", "bcc", "method bcc"}}) {
    client::SettingsUpdate update;
    const Setting& setting = *FindSetting(name);
    EXPECT_TRUE(StoreSetting(setting, value, update)) << name;
    EXPECT_EQ(DescribeSetting(setting, Told(update)), told);
    // Nothing else is sent.
    ASSERT_EQ(client::ToProto(update).update_mask().paths_size(), 1) << name;
    EXPECT_EQ(client::ToProto(update).update_mask().paths(0), setting.key);
  }
}

TEST(CliSetting, AnythingElseIsNotStored) {
  const std::map<std::string, std::vector<std::string>> wrong = {
      {"stiffness", {"", "nan", "inf", "-inf", "1e999", "1 ", "1N", "on"}},
      {"force_shading", {"1", "2", ""}},
      {"free_side", {"unspecified", "BELOW", "1", "left"}},
      {"method", {"FREE_SIDE_BELOW", "cubes"}}};
  client::SettingsUpdate update;
  for (const auto& [name, values] : wrong) {
    for (const std::string& value : values) {
      EXPECT_FALSE(StoreSetting(*FindSetting(name), value, update)) << name << " " << value;
    }
  }
  EXPECT_EQ(client::ToProto(update).update_mask().paths_size(), 0);
}

TEST(CliLayers, AListIsSoftButForTheInnermost) {
  const auto number = [](const std::string& text) { return std::stod(text); };
  const SurfaceLayers layers = LayersOfList("bone=300,skin=-300,fat=-80", number);
  ASSERT_EQ(layers.layer.size(), 3u);
  for (const SurfaceLayer& layer : layers.layer) {
    EXPECT_EQ(layer.pop_force_n > 0.0, layer.name != "bone");
  }
  EXPECT_EQ(LayersOfList("skin-bone", number).layer[1].isovalue, 300.0);
  for (const char* wrong : {"", "skin", "=3", ","}) {
    EXPECT_THROW(LayersOfList(wrong, number), Error) << wrong;
  }
  // As JSON, they come back.
  EXPECT_EQ(LayersOfJson(ToJson(layers).dump()), layers);
  for (const char* wrong :
       {"", "{}", "[]", R"({"layer":[{"name":3}]})", R"({"layer":[{"colour":"red"}]})"}) {
    EXPECT_THROW(LayersOfJson(wrong), Error) << wrong;
  }
}

TEST(CliSetting, WhatIsOffSharesALine) {
  v1::RenderSettings settings;
  settings.set_isovalue(0.0);
  settings.set_stiffness_n_per_mm(0.5);
  settings.set_damping_n_s_per_m(0.0);
  settings.set_force_shading(false);
  const std::string text = Describe(Told(settings));
  for (const char* line : {"revision 3\n", " isovalue 0\n", " stiffness 0.5 N/mm\n",
                           " off: damping, force_shading\n"}) {
    EXPECT_NE(text.find(line), std::string::npos) << text;
  }
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4);
}

TEST(CliSetting, JsonHasAllByTheirKeys) {
  v1::RenderSettings settings;
  settings.set_isovalue(0.0);
  settings.set_force_shading(false);
  settings.set_free_side(static_cast<v1::FreeSide>(17));  // of a newer daemon
  const Json json = ToJson(Told(settings));
  EXPECT_EQ(json["settings_revision"], 3);
  EXPECT_EQ(json["isovalue"], 0.0);
  EXPECT_EQ(json["force_shading"], false);
  EXPECT_TRUE(json["free_side"].is_null());
  EXPECT_TRUE(json["normalized_isovalue"].is_null());  // of an older daemon
}

TEST(CliSetting, SaysWhatWasAppliedWhen) {
  client::SettingsResult result;
  result.settings.isovalue = 40.8;
  result.settings.normalized_isovalue = 0.16;
  result.settings.method = DecompositionMethod::kBcc;
  result.settings.revision = 7;
  result.applied_tick = 123456;
  result.receipt_to_applied_ns = 1'200'000;
  EXPECT_EQ(DescribeChange(client::kIsovalue, result),
            "isovalue 40.8 applied at tick 123456, settings revision 7, 1.2 ms after receipt");
  EXPECT_TRUE(DescribeChange(client::kNormalizedIsovalue, result)
                  .starts_with("isovalue 40.8 (normalised 0.16)"));
  EXPECT_TRUE(DescribeChange(*FindSetting("method"), result).starts_with("method bcc applied"));
}

client::UnalignedQuaternion Turn(const std::string& text) {
  const std::optional<client::UnalignedQuaternion> rotation = ParseTurn(text);
  EXPECT_TRUE(rotation) << text;
  return rotation.value_or(client::UnalignedQuaternion(0.0, 0.0, 0.0, 0.0));
}

TEST(CliPlace, ParsesTurns) {
  const double half = std::sqrt(0.5), five_deg = 10.0 / 360.0 * 3.14159265358979323846;
  EXPECT_NEAR(Turn("x,90").x(), half, 1e-15);
  EXPECT_NEAR(Turn("y,-90").y(), -half, 1e-15);
  EXPECT_NEAR(Turn("z,+180").z(), 1.0, 1e-15);
  EXPECT_NEAR(Turn("z,1e1").w(), std::cos(five_deg), 1e-15);
  EXPECT_EQ(Turn("x,360").w(), 1.0);
  EXPECT_NEAR(Turn("y,3600000090").y(), half, 1e-12);
  EXPECT_NEAR(Turn("z,1e300").norm(), 1.0, 1e-14);
  for (const char* text : {"", "x", "x,", "90", "w,90", "x90", "x,nan", "x,inf", "x,90deg", "x, 90",
                           "xy,90", "x,+-9", "x,1e999", "X,90"}) {
    EXPECT_FALSE(ParseTurn(text)) << text;
  }
}

TEST(CliPlace, TextAndJsonHaveEveryField) {
  client::Placement placement = {.center_mm = {1.5, -2.0, 0.1},
                                 .rotation = Turn("y,90"),
                                 .device_mm_per_volume_mm = 0.5,
                                 .device_mm_per_voxel = 0.25};
  EXPECT_EQ(
      Describe(placement),
      "place     centre at 1.5, -2, 0.1 mm of the device; turned by 90° about (0, 1, 0)\n"
      "          0.5 mm of the device per mm of the volume, 0.25 per voxel: 1 mm is 4 cells\n");
  const Json json = PlacementJson(placement);
  EXPECT_EQ(json["rotation_wxyz"].size(), 4u);
  EXPECT_EQ(json["device_mm_per_volume_mm"], 0.5);
  placement.rotation = Turn("x,-90");
  EXPECT_NE(Describe(placement).find("90° about (-1, 0, 0)"), std::string::npos);
  placement.rotation = client::UnalignedQuaternion::Identity();
  EXPECT_NE(Describe(placement).find("; not turned\n"), std::string::npos);
}

TEST(CliVolume, TextFromElsewhereStaysOnItsLine) {
  EXPECT_EQ(OneLine("a\nb\tc\x7f"), "a b c ");
  EXPECT_EQ(OneLine("N·s"), "N·s");
  client::VolumeInfo volume;
  volume.source = "evil\n\x1b[2Jname";
  const std::string text = Describe(volume);
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 6);
  volume.source = "/data/\xff.nrrd";  // no UTF-8
  EXPECT_TRUE(Json::accept(ToText(ToJson(volume))));
}

TEST(CliVolume, ARecordingIsDescribed) {
  client::RecordingState state;
  state.path = "/data/a\n.mcap";
  EXPECT_EQ(DescribeRecording(state), "0 ticks (0.0 s), 0 lost, 0.0 MB, to /data/a .mcap");
  state.ticks = 60000;
  state.lost_ticks = 7;
  state.size_bytes = 6'180'000;
  EXPECT_EQ(DescribeRecording(state),
            "60000 ticks (60.0 s), 7 lost, 6.2 MB, 103 bytes per tick, to /data/a .mcap");
}

TEST(CliPaths, RelativePathsBecomeAbsoluteOnTheSameMachineAlone) {
  for (const bool is_here : {true, false}) {
    EXPECT_EQ(PathThere("/data/a.nrrd", is_here, "or-2:7411"), "/data/a.nrrd");
    EXPECT_THROW(PathThere("", is_here, "or-2:7411"), Error);
  }
  EXPECT_EQ(PathThere("a.nrrd", true, "unix:/s"),
            (std::filesystem::current_path() / "a.nrrd").string());
  EXPECT_THROW(PathThere("a.nrrd", false, "or-2:7411"), Error);
}

TEST(CliPaths, ATokenThatOthersMayReadIsWarnedOf) {
  const test::TemporaryFolder folder;
  const std::string path = folder.path() / "token";
  std::ofstream(path) << "palpate_x\n";
  for (const auto& [mode, warns] : std::map<mode_t, bool>{
           {0600, false}, {0640, false}, {0660, false}, {0644, true}, {0604, true}}) {
    ASSERT_EQ(chmod(path.c_str(), mode), 0);
    EXPECT_EQ(TokenFileWarning(path).find(path) != std::string::npos, warns) << mode;
    EXPECT_EQ(TokenFileWarning(path).empty(), !warns) << mode;
  }
  EXPECT_EQ(TokenFileWarning(""), "");
  EXPECT_EQ(TokenFileWarning(path + ".absent"), "");
}

}  // namespace
}  // namespace palpate::cli
