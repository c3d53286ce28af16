// A control shows the user's value until palpated has it, and not for ever.
#include "client/view/viewer/held_values.h"

#include <gtest/gtest.h>

namespace palpate::view {
namespace {

constexpr HeldValues::Clock::time_point kNow{};
constexpr HeldValues::Clock::time_point kLater = kNow + HeldValues::kPatience;
constexpr HeldValues::Clock::time_point kTooLate = kLater + std::chrono::milliseconds(1);

TEST(HeldValues, ShowsTheUsersUntilItIsAgreed) {
  HeldValues held;
  EXPECT_EQ(held.Shown(1, 5.0, kNow), 5.0);
  held.Update(1, 7.0, true, true, kNow);
  EXPECT_EQ(held.Shown(1, 5.0, kNow), 7.0);
  EXPECT_EQ(held.Shown(2, 5.0, kNow), 5.0);
  // Another client's value does not take it out of the hand.
  EXPECT_EQ(held.Shown(1, 7.0, kNow), 7.0);
  EXPECT_EQ(held.Shown(1, 6.0, kNow), 7.0);
  held.Update(1, 7.0, false, false, kNow);
  EXPECT_EQ(held.Shown(1, 5.0, kNow), 7.0);
  EXPECT_EQ(held.Shown(1, 7.0, kNow), 7.0);
  EXPECT_EQ(held.Shown(1, 6.0, kNow), 6.0);
}

// Nor does a panel tell more that is hidden while its control is held.
TEST(HeldValues, GivesUpWhatPalpatedDoesNotTake) {
  for (const bool is_hidden : {false, true}) {
    HeldValues held;
    held.Update(1, 7.0, true, true, kNow);
    if (!is_hidden) held.Update(1, 7.0, false, false, kNow);
    EXPECT_EQ(held.Shown(1, 5.0, kLater), 7.0);
    EXPECT_EQ(held.Shown(1, 5.0, kTooLate), 5.0);
  }
}

}  // namespace
}  // namespace palpate::view
