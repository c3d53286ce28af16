// A script that presses buttons over another one.
#include "server/device/press_script.h"

#include <gtest/gtest.h>

#include "server/device/path_script.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

std::unique_ptr<StylusScript> Path() {
  return std::make_unique<PathScript>(std::vector<Vec3>{Vec3(0, 0, 0), Vec3(100, 0, 0)}, 50.0);
}

TEST(PressScript, HoldsTheButtonsForAThirdOfTheTimeAndLeavesTheWay) {
  PressScript script(Path(), 2u);
  const auto plain = Path();
  int pressed = 0, presses = 0;
  std::uint32_t last = 0;
  for (int n = 0; n < 30'000; ++n) {
    const StylusScript::Target target = script.Next({}, Vec3::Zero(), 1e-3);
    EXPECT_EQ(target.p_DTarget_mm, plain->Next({}, Vec3::Zero(), 1e-3).p_DTarget_mm);
    EXPECT_EQ(target.buttons & ~2u, 0u);
    pressed += target.buttons == 2u;
    presses += target.buttons != 0 && last == 0;
    last = target.buttons;
  }
  EXPECT_NEAR(pressed, 10'000, 20);
  EXPECT_EQ(presses, 10);
}

TEST(PressScript, WithoutButtonsOrAScript) {
  PressScript script(Path(), 0);
  for (int n = 0; n < 5000; ++n) EXPECT_EQ(script.Next({}, Vec3::Zero(), 1e-3).buttons, 0u);
  EXPECT_EQ(testing::Refusal([] { PressScript(nullptr, 1); }), ErrorKind::kInvalidArgument);
}

}  // namespace
}  // namespace palpate
