// In every window the parts lie beside each other within it, and the view has its half.
#include "client/view/viewer/layout.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace palpate::view {
namespace {

constexpr float kRounding_px = 0.01f;

std::vector<Area> AreasOf(const Layout& layout) {
  return {layout.top,        layout.left,   layout.left_edge,  layout.right,
          layout.right_edge, layout.state,  layout.tools,      layout.view,
          layout.series,     layout.slices, layout.drawer_bar, layout.drawer};
}

bool Overlap(const Area& a, const Area& b) {
  const auto overlap = [](float a_min, float a_size, float b_min, float b_size) {
    return std::min(a_min + a_size, b_min + b_size) - std::max(a_min, b_min) > kRounding_px;
  };
  return overlap(a.min.x, a.size.x, b.min.x, b.size.x) &&
         overlap(a.min.y, a.size.y, b.min.y, b.size.y);
}

void ExpectInOrder(const ImVec2& screen, const Layout& layout) {
  const std::vector<Area> areas = AreasOf(layout);
  for (std::size_t n = 0; n < areas.size(); ++n) {
    const Area& area = areas[n];
    EXPECT_TRUE(area.size.x >= 0.0f && area.size.y >= 0.0f) << n;
    EXPECT_TRUE(area.min.x >= 0.0f && area.min.x + area.size.x <= screen.x + kRounding_px) << n;
    EXPECT_TRUE(area.min.y >= 0.0f && area.min.y + area.size.y <= screen.y + kRounding_px) << n;
    for (std::size_t other = 0; other < n; ++other)
      EXPECT_FALSE(Overlap(area, areas[other])) << n << " " << other;
  }
  EXPECT_GE(layout.view.size.x, 0.5f * screen.x - kRounding_px);
}

TEST(ViewLayout, FourPanesAreEqualAndLieBesideEachOther) {
  const Layout layout = LayOut({1280.0f, 800.0f}, 1.0f,
                               {.preferences = Preferences(), .in_four = true, .notice = true});
  const SliceStrip strip = LayOutSlices(layout, 1.0f);
  std::vector<Area> areas(strip.slices.begin(), strip.slices.end());
  areas.push_back(layout.view);
  for (const Area& area : areas) {
    EXPECT_EQ(area.size.x, layout.view.size.x);
    EXPECT_EQ(area.size.y, layout.view.size.y);
  }
  areas.insert(areas.end(), {strip.row, strip.bar, layout.notice, layout.tools, layout.left,
                             layout.right, layout.drawer_bar});
  for (std::size_t a = 0; a < areas.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      const auto apart = [](float p, float size_p, float q, float size_q) {
        return p + size_p <= q + 0.01f || q + size_q <= p + 0.01f;
      };
      EXPECT_TRUE(apart(areas[a].min.x, areas[a].size.x, areas[b].min.x, areas[b].size.x) ||
                  apart(areas[a].min.y, areas[a].size.y, areas[b].min.y, areas[b].size.y))
          << a << " and " << b;
    }
  }
}

TEST(ViewLayout, PartsLieBesideEachOther) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> share(0.0f, 1.0f);
  for (int n = 0; n < 20000; ++n) {
    const float scale = 0.8f + 3.2f * share(random);
    // As large as a window can be for its scale, which includes the font size.
    const ImVec2 screen{640.0f + 3000.0f * share(random), 400.0f + 1800.0f * share(random)};
    const LayoutParts parts{
        .preferences = {.left_width_px = 200.0 + 600.0 * static_cast<double>(share(random)),
                        .right_width_px = 200.0 + 600.0 * static_cast<double>(share(random)),
                        .left_shown = random() % 2 == 0,
                        .right_shown = random() % 2 == 0,
                        .narrow_side = random() % 2 == 0 ? Side::kLeft : Side::kRight,
                        .plots_shown = random() % 2 == 0},
        .series = random() % 2 == 0,
        .slices = random() % 2 == 0};
    const Layout layout = LayOut(screen, scale, parts);
    ExpectInOrder(screen, layout);
    if (HasFailure()) FAIL() << screen.x << " x " << screen.y << " at " << scale;
  }
}

TEST(ViewLayout, SidesAreThereWhereThereIsRoom) {
  const Layout wide = LayOut({1280.0f, 800.0f}, 1.0f, {.preferences = Preferences()});
  EXPECT_EQ(wide.left.size.x, 300.0f);
  EXPECT_EQ(wide.right.size.x, 300.0f);
  EXPECT_EQ(wide.drawer.size.y, 0.0f);
  Preferences preferences;
  for (const Side side : {Side::kLeft, Side::kRight}) {
    preferences.narrow_side = side;
    const Layout narrow = LayOut({800.0f, 600.0f}, 1.0f, {.preferences = preferences});
    EXPECT_EQ(narrow.left.size.x > 0.0f, side == Side::kLeft);
    EXPECT_EQ(narrow.right.size.x > 0.0f, side == Side::kRight);
  }
  preferences.left_shown = preferences.right_shown = false;
  EXPECT_EQ(LayOut({1280.0f, 800.0f}, 1.0f, {.preferences = preferences}).view.size.x, 1280.0f);
}

TEST(ViewLayout, TheSmallestWindowHasAView) {
  const Layout small = LayOut({640.0f, 400.0f}, 1.0f, {.preferences = Preferences()});
  EXPECT_GE(small.view.size.y, 200.0f);
  EXPECT_EQ(small.slices.size.y, 0.0f);
  EXPECT_GE(small.state.size.y, 20.0f);
}

TEST(ViewLayout, TheDrawerFollowsTheUserAndElseTheHeight) {
  EXPECT_FALSE(ShowsPlots({}, kHighWindow_px - 1.0f, 1.0f));
  EXPECT_TRUE(ShowsPlots({}, kHighWindow_px, 1.0f));
  EXPECT_FALSE(ShowsPlots({}, kHighWindow_px, 2.0f));
  EXPECT_TRUE(ShowsPlots({.plots_shown = true}, 400.0f, 1.0f));
  EXPECT_FALSE(ShowsPlots({.plots_shown = false}, 2000.0f, 1.0f));
}

}  // namespace
}  // namespace palpate::view
