// What Esc closes, and when it stops the forces.
#include "client/view/viewer/escape.h"

#include <gtest/gtest.h>

namespace palpate::view {
namespace {

using std::chrono::milliseconds;

constexpr Open kOpen[] = {Open::kField,   Open::kPopup, Open::kPathForm,
                          Open::kConnect, Open::kHelp,  Open::kQuestion};
const EscapeRule::Clock::time_point kStart{};

TEST(Escape, StopsAtOnceWhereNothingIsOpen) {
  EscapeRule rule;
  EXPECT_TRUE(rule.Press(Open::kNothing, kStart));
  EXPECT_EQ(rule.TakeClosing(), Open::kNothing);
  EXPECT_FALSE(rule.Warns(kStart));
}

TEST(Escape, ClosesWhatIsOpenAndStopsAtTheSecondPressWithinASecond) {
  for (const Open first : kOpen) {
    for (const Open then : kOpen) {
      EscapeRule rule;
      EXPECT_FALSE(rule.Press(first, kStart));
      EXPECT_EQ(rule.TakeClosing(), first);
      EXPECT_TRUE(rule.Warns(kStart + milliseconds(1000)));
      EXPECT_FALSE(rule.Warns(kStart + milliseconds(1001)));
      EXPECT_TRUE(rule.Press(then, kStart + milliseconds(1000)));
      EXPECT_EQ(rule.TakeClosing(), Open::kNothing);
      EXPECT_FALSE(rule.Warns(kStart + milliseconds(1000)));
    }
  }
}

TEST(Escape, LaterItClosesTheNextThing) {
  EscapeRule rule;
  EXPECT_FALSE(rule.Press(Open::kPopup, kStart));
  EXPECT_EQ(rule.TakeClosing(), Open::kPopup);
  EXPECT_FALSE(rule.Press(Open::kHelp, kStart + milliseconds(1001)));
  EXPECT_EQ(rule.TakeClosing(), Open::kHelp);
  EXPECT_TRUE(rule.Press(Open::kNothing, kStart + milliseconds(5000)));
}

TEST(Escape, ASecondPressBeforeTheFrameStops) {
  EscapeRule rule;
  EXPECT_FALSE(rule.Press(Open::kHelp, kStart));
  EXPECT_TRUE(rule.Press(Open::kHelp, kStart + milliseconds(3000)));
}

}  // namespace
}  // namespace palpate::view
