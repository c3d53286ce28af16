// `palpate place`: turns, wording, and command lines that are refused before any
// daemon is asked.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "client/cli/description.h"
#include "client/cli/place_command.h"
#include "tests/support/places.h"
#include "tests/support/process.h"

namespace palpate::cli {
namespace {

client::UnalignedQuaternion Turn(const std::string& text) {
  const std::optional<client::UnalignedQuaternion> rotation = ParseTurn(text);
  EXPECT_TRUE(rotation) << text;
  return rotation.value_or(client::UnalignedQuaternion(0.0, 0.0, 0.0, 0.0));
}

TEST(CliPlace, ParsesTurns) {
  EXPECT_NEAR(Turn("x,90").x(), std::sqrt(0.5), 1e-15);
  EXPECT_NEAR(Turn("y,-90").y(), -std::sqrt(0.5), 1e-15);
  EXPECT_NEAR(Turn("z,+180").z(), 1.0, 1e-15);
  EXPECT_NEAR(Turn("z,1e1").w(), std::cos(10.0 / 360.0 * 3.14159265358979323846), 1e-15);
  EXPECT_EQ(Turn("x,0").w(), 1.0);
  EXPECT_EQ(Turn("x,360").w(), 1.0);
  EXPECT_NEAR(Turn("y,3600000090").y(), std::sqrt(0.5), 1e-12);
  for (const char* text : {"x,90", "y,-7.5", "z,1e300"}) {
    EXPECT_NEAR(Turn(text).norm(), 1.0, 1e-14);
  }
}

TEST(CliPlace, RefusesWhatIsNoTurn) {
  for (const char* text : {"", "x", "x,", "90", "w,90", "x90", "x,nan", "x,inf", "x,90deg", "x, 90",
                           "xy,90", "x,+-9", "x,1e999", "X,90"}) {
    EXPECT_FALSE(ParseTurn(text)) << text;
  }
}

client::Placement Placement() {
  return {.center_mm = {1.5, -2.0, 0.1},
          .rotation = Turn("y,90"),
          .device_mm_per_volume_mm = 0.5,
          .device_mm_per_voxel = 0.25};
}

TEST(CliPlace, Wording) {
  EXPECT_EQ(
      Describe(Placement()),
      "place     centre at 1.5, -2, 0.1 mm of the device; turned by 90° about (0, 1, 0)\n"
      "          0.5 mm of the device per mm of the volume, 0.25 per voxel: 1 mm is 4 cells\n");
  client::Placement straight = Placement();
  straight.rotation = client::UnalignedQuaternion::Identity();
  EXPECT_NE(Describe(straight).find("; not turned\n"), std::string::npos);
  straight.rotation = Turn("x,-90");
  EXPECT_NE(Describe(straight).find("90° about (-1, 0, 0)"), std::string::npos)
      << Describe(straight);
}

TEST(CliPlace, JsonHasEveryFieldWithItsUnit) {
  const Json json = ToJson(Placement());
  EXPECT_EQ(json["center_mm"], Json({1.5, -2.0, 0.1}));
  EXPECT_EQ(json["rotation_wxyz"].size(), 4u);
  EXPECT_EQ(json["device_mm_per_volume_mm"], 0.5);
  EXPECT_EQ(json["device_mm_per_voxel"], 0.25);
}

TEST(CliPlace, WrongUsageIsOneLineAndExitCode2) {
  for (std::vector<std::string> arguments : std::vector<std::vector<std::string>>{
           {"extra"},
           {"--move-mm"},
           {"--move-mm", "1,2"},
           {"--move-mm", "1,2,x"},
           {"--center-mm", "1,nan,2"},
           {"--center-mm", "inf,0,0"},
           {"--rotation-wxyz", "1,0,0"},
           {"--turn-deg", "90"},
           {"--turn-deg", "y,ninety"},
           {"--scale-by", "0"},
           {"--scale-by", "-1"},
           {"--cells-per-mm", "0"},
           {"--cells-per-mm", "2", "--device-mm-per-voxel", "0.5"},
           {"--cells-per-mm", "2", "--device-mm-per-volume-mm", "0.5"},
           {"--device-mm-per-voxel", "2", "--device-mm-per-volume-mm", "0.5"},
           {"--expected-revision", "3"}}) {
    arguments.insert(arguments.begin(), {test::kPalpate, "place"});
    const test::ProcessResult result = test::Process(arguments).Wait();
    EXPECT_EQ(result.exit_code, 2) << arguments.back() << result.error;
    EXPECT_EQ(std::count(result.error.begin(), result.error.end(), '\n'), 1) << result.error;
  }
}

}  // namespace
}  // namespace palpate::cli
