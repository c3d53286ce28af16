// A control shows the user's value until palpated has it, and not for ever.
#include "client/view/app/held_values.h"

#include <gtest/gtest.h>

#include "tests/support/patience.h"

namespace palpate::view {
namespace {

bool SoonShows(HeldValues& held, unsigned id, double told) {
  return test::Eventually([&] { return held.Shown(id, told) == told; });
}

TEST(HeldValues, ShowsTheUsersUntilItIsAgreed) {
  HeldValues held;
  EXPECT_EQ(held.Shown(1, 5.0), 5.0);
  held.Update(1, 7.0, true, true);
  EXPECT_EQ(held.Shown(1, 5.0), 7.0);
  EXPECT_EQ(held.Shown(2, 5.0), 5.0);
  // Another client's value does not take it out of the hand.
  EXPECT_EQ(held.Shown(1, 7.0), 7.0);
  EXPECT_EQ(held.Shown(1, 6.0), 7.0);
  held.Update(1, 7.0, false, false);
  EXPECT_EQ(held.Shown(1, 5.0), 7.0);
  EXPECT_EQ(held.Shown(1, 7.0), 7.0);
  EXPECT_EQ(held.Shown(1, 6.0), 6.0);
}

TEST(HeldValues, GivesUpWhatPalpatedDoesNotTake) {
  HeldValues held;
  held.Update(1, 7.0, true, true);
  held.Update(1, 7.0, false, false);
  EXPECT_EQ(held.Shown(1, 5.0), 7.0);
  EXPECT_TRUE(SoonShows(held, 1, 5.0));
}

// A panel that is hidden while its control is held tells nothing more.
TEST(HeldValues, LetsGoOfAControlThatIsNoLongerDrawn) {
  HeldValues held;
  held.Update(1, 7.0, true, true);
  EXPECT_EQ(held.Shown(1, 5.0), 7.0);
  EXPECT_TRUE(SoonShows(held, 1, 5.0));
}

}  // namespace
}  // namespace palpate::view
