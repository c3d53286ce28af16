// The viewer's own rules: what Esc closes, whose value a control shows, what filter is asked for,
// and what is in a tool's way.
#include <gtest/gtest.h>

#include <algorithm>

#include "client/view/palpated/setting_change.h"
#include "client/view/palpated/taken_tool.h"
#include "client/view/viewer/escape.h"
#include "client/view/viewer/filter_form.h"
#include "client/view/viewer/user_actions.h"

namespace palpate::view {

namespace {

using std::chrono::milliseconds;

constexpr Open kOpen[] = {Open::kField, Open::kPopup,    Open::kPathForm, Open::kConnect,
                          Open::kHelp,  Open::kQuestion, Open::kDistance};
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

namespace {

using client::FilterKind;

const Vec3i kFilteredSize(40, 50, 60);

TEST(FilterForm, HasNoMoreIterationsThanTheDaemonTakes) {
  for (int kind = 1; kind <= 6; ++kind) {
    for (int width = 0; width < 12; ++width) {
      FilterForm form;
      form.filter.kind = static_cast<FilterKind>(kind);
      form.filter.width = width;
      form.filter.iterations = 5000;
      const auto filter = FilterOf(form, {}, kFilteredSize, {});
      ASSERT_TRUE(filter);
      EXPECT_GE(filter->width, 1);
      EXPECT_LE(filter->width, 8);
      EXPECT_GE(filter->iterations, 1);
      const int product = filter->width * filter->iterations;
      if (filter->kind == FilterKind::kGaussian) {
        EXPECT_LE(product, 8);
      }
      if (filter->kind == FilterKind::kMean || filter->kind == FilterKind::kMedian) {
        EXPECT_LE(product, 32);
      }
      EXPECT_LE(filter->iterations, 1000);
    }
  }
}

TEST(FilterForm, OfTheCropBoxReplacesItsVoxelsAlone) {
  FilterForm form{.region = FilterRegion::kCropBox};
  const CropBox crop{.min = Vec3(0.0, 0.5, 0.25), .max = Vec3(1.0, 0.75, 0.5)};
  const auto filter = FilterOf(form, crop, kFilteredSize, {});
  ASSERT_TRUE(filter);
  const auto* box = std::get_if<client::Box>(&filter->region);
  ASSERT_TRUE(box);
  EXPECT_EQ(filter->frame, client::EditFrame::kIndex);
  // The layer of background is no part of the volume.
  EXPECT_EQ(box->min.x(), 0.0);
  EXPECT_EQ(box->max.x(), 39.0);
  EXPECT_NEAR(box->min.y(), 24.5, 1e-12);
  EXPECT_NEAR(box->max.z(), 29.5, 1e-12);
}

TEST(FilterForm, OfTheBallNeedsItsMiddle) {
  FilterForm form{.region = FilterRegion::kProxyBall, .radius_mm = 7.0};
  EXPECT_FALSE(FilterOf(form, {}, kFilteredSize, {}));
  const auto filter = FilterOf(form, {}, kFilteredSize, Vec3(1, 2, 3));
  ASSERT_TRUE(filter);
  const auto* ball = std::get_if<client::Sphere>(&filter->region);
  ASSERT_TRUE(ball);
  EXPECT_EQ(ball->center, Vec3(1, 2, 3));
  EXPECT_EQ(ball->radius, 7.0);
  EXPECT_EQ(filter->frame, client::EditFrame::kWorld);
  // Of a filter of whole volumes the region is left out.
  form.filter.kind = FilterKind::kResample;
  const auto whole = FilterOf(form, {}, kFilteredSize, {});
  ASSERT_TRUE(whole);
  EXPECT_TRUE(std::holds_alternative<std::monostate>(whole->region));
}

}  // namespace

namespace {

// What is in a tool's way is named and removed with it; what a tool does not feel is not shown.
TEST(TakenTool, RemovesWhatIsInItsWay) {
  const HeldTool tool{.name = "burr", .ball = {{.radius_mm = 3.0}}};
  client::Settings now;
  EXPECT_TRUE(TakeTool(tool, now, 1.0).needs.empty());
  now.layers.layer = {{.name = "skin", .isovalue = 1.0}, {.name = "bone", .isovalue = 2.0}};
  now.pop_force_n = 1.0;
  const TakenTool taken = TakeTool(tool, now, 0.3);
  EXPECT_EQ(taken.needs.size(), 3u);
  EXPECT_EQ(taken.update.isovalue, 2.0);
  EXPECT_TRUE(taken.update.layers && taken.update.layers->layer.empty());
  EXPECT_EQ(taken.update.pop_force_n, 0.0);
  EXPECT_FALSE(taken.update.dynamic_friction);
  EXPECT_LE(taken.update.tool->ball[0].radius_mm, 8.0 * 0.3);
  EXPECT_GE(*taken.magnification * 8.0 * 0.3, 3.0);
  now = {};
  const auto shown = [&] {
    return std::ranges::count_if(client::kSettings, [&](const auto& s) { return IsShown(s, now); });
  };
  const auto all = shown();
  now.tool = tool;
  EXPECT_EQ(shown(), all - 7);  // friction twice, grain, ball, pop, magnet, shading
}

}  // namespace

}  // namespace palpate::view
