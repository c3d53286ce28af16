// The places of the panels.
//
//   top bar
//   left side | state bar, tool bar, view, series, slices | right side
//   plots drawer
//
// Pixels of the screen from its upper left corner. Threads: pure.
#pragma once

#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "client/view/drawing/camera.h"
#include "client/view/viewer/preferences.h"

namespace palpate::view {

struct Area {
  ImVec2 min;
  ImVec2 size;

  bool Holds(const Eigen::Vector2d& at) const {
    const Eigen::Vector2d in = at - Eigen::Vector2d(min.x, min.y);
    return in.minCoeff() >= 0.0 && in.x() < size.x && in.y() < size.y;
  }
};

// An area that is not shown has no width or no height.
struct Layout {
  Area top;
  Area left;
  Area left_edge;  // drags the side's width
  Area right;
  Area right_edge;
  Area state;   // above the view
  Area tools;   // above the view
  Area notice;  // above the view, if there is one
  Area view;
  Area series;  // below the view, if there is a series
  Area slices;  // below the series; of four equal panes: the view and all around it
  bool in_four = false;
  Area drawer_bar;  // opens and closes the drawer
  Area drawer;
};

// The parts of the slices' area.
struct SliceStrip {
  Area row;  // of controls
  std::array<Area, 3> slices;
  Area bar;  // of the colours
};

// Outlived by what it refers to.
struct LayoutParts {
  const Preferences& preferences;
  bool in_four = false;  // four equal panes: the view and three slices
  bool notice = false;
  bool series = false;
  bool slices = true;
};

// Windows lower than this, in pixels at scale 1, begin with a closed drawer: else the view would be
// lower than the slices.
inline constexpr float kHighWindow_px = 900.0f;
// Both sides are shown if each can be this wide.
inline constexpr float kBothSides_px = 250.0f;
// Lower windows have no slices.
inline constexpr float kSlices_px = 480.0f;

inline bool ShowsPlots(const Preferences& preferences, float screen_height, float scale) {
  return preferences.plots_shown.value_or(screen_height >= kHighWindow_px * scale);
}

// The widths of the sides.
struct SideWidths {
  float left = 0.0f;
  float right = 0.0f;
};

// At most `room` together. Where there is room for one only, the preferences say which.
inline SideWidths WidthsOf(const Preferences& preferences, float room, float scale) {
  SideWidths widths{
      preferences.left_shown ? static_cast<float>(preferences.left_width_px) * scale : 0.0f,
      preferences.right_shown ? static_cast<float>(preferences.right_width_px) * scale : 0.0f};
  const bool both = preferences.left_shown && preferences.right_shown;
  if (both && room < 2.0f * kBothSides_px * scale) {
    (preferences.narrow_side == Side::kLeft ? widths.right : widths.left) = 0.0f;
  } else if (both && widths.left + widths.right > room) {
    const float least = static_cast<float>(kLeastSide_px) * scale;
    widths.left =
        std::clamp(room * widths.left / (widths.left + widths.right), least, room - least);
    widths.right = room - widths.left;
  }
  return {std::floor(std::min(widths.left, room)), std::floor(std::min(widths.right, room))};
}

inline constexpr float kPaneGap = 2.0f;
// Of the slices' area: the height of the row of controls, and the width of the bar of colours.
inline float RowOfSlices(const Area& area, float scale) {
  return std::min(26.0f * scale, 0.4f * area.size.y);
}
inline float BarOfSlices(const Area& area, float scale) {
  return std::min(54.0f * scale, 0.2f * area.size.x);
}
inline ImVec2 PaneOfFour(const Area& area, float scale) {
  return {std::max(1.0f, std::floor(0.5f * (area.size.x - BarOfSlices(area, scale) - kPaneGap))),
          std::max(1.0f, std::floor(0.5f * (area.size.y - RowOfSlices(area, scale) - kPaneGap)))};
}

// `scale`: 1 on screens of about 100 pixels per inch at a font size of 100 %. The view has at least
// half of the width.
inline Layout LayOut(const ImVec2& screen, float scale, const LayoutParts& parts) {
  const float top = std::min(40.0f * scale, 0.2f * screen.y);
  const float edge = 6.0f * scale;
  const SideWidths sides =
      WidthsOf(parts.preferences, std::max(0.0f, 0.5f * screen.x - 2.0f * edge), scale);
  const float left_edge = sides.left > 0.0f ? edge : 0.0f;
  const float right_edge = sides.right > 0.0f ? edge : 0.0f;
  const float x = sides.left + left_edge;
  const float middle = std::max(1.0f, screen.x - x - sides.right - right_edge);
  const bool plots = ShowsPlots(parts.preferences, screen.y, scale);
  const float drawer = plots ? std::min(150.0f * scale, 0.25f * screen.y) : 0.0f;
  const float bar = 24.0f * scale;
  const float height = std::max(1.0f, screen.y - top - bar - drawer);
  const float state = std::min(32.0f * scale, 0.3f * height);
  const float tools = std::min(32.0f * scale, 0.3f * height);
  const float notice = parts.notice ? std::min(28.0f * scale, 0.1f * height) : 0.0f;
  const float rest = height - state - tools - notice;
  const float series = parts.series ? std::min(44.0f * scale, 0.4f * rest) : 0.0f;
  // A slice is about as wide as it is high.
  const bool slices_fit = parts.slices && screen.y >= kSlices_px * scale;
  const float slices = slices_fit
                           ? std::floor(std::min({middle / 3.0f, screen.y / (plots ? 4.0f : 3.0f),
                                                  0.5f * rest - series}))
                           : 0.0f;
  const float view = rest - slices - series;
  Layout layout;
  float y = 0.0f;
  const auto below = [&y](float left, float width, float high) {
    const Area area{{left, y}, {width, high}};
    y += high;
    return area;
  };
  layout.top = below(0.0f, screen.x, top);
  layout.left = {{0.0f, top}, {sides.left, height}};
  layout.left_edge = {{sides.left, top}, {left_edge, height}};
  layout.right = {{screen.x - sides.right, top}, {sides.right, height}};
  layout.right_edge = {{screen.x - sides.right - right_edge, top}, {right_edge, height}};
  layout.state = below(x, middle, state);
  layout.tools = below(x, middle, tools);
  layout.notice = below(x, middle, notice);
  layout.view = below(x, middle, view);
  layout.series = below(x, middle, series);
  layout.slices = below(x, middle, slices);
  layout.in_four = parts.in_four && slices > 0.0f;
  if (layout.in_four) {
    layout.series.min.y = layout.view.min.y;
    const float y_panes = layout.view.min.y + series;
    layout.slices = {{x, y_panes}, {middle, view + slices}};
    layout.view = {layout.slices.min, PaneOfFour(layout.slices, scale)};
  }
  layout.drawer_bar = {{0.0f, top + height}, {screen.x, bar}};
  layout.drawer = {{0.0f, top + height + bar}, {screen.x, drawer}};
  return layout;
}

inline SliceStrip LayOutSlices(const Layout& layout, float scale) {
  const Area& area = layout.slices;
  const float row = RowOfSlices(area, scale);
  const float bar = BarOfSlices(area, scale);
  if (layout.in_four) {
    const ImVec2 pane = layout.view.size;
    const float x = area.min.x + pane.x + kPaneGap, y = area.min.y + pane.y + kPaneGap;
    const float below = y + pane.y;
    return {.row = {{area.min.x, below}, {area.size.x, row}},
            .slices = {{{{area.min.x, y}, pane}, {{x, area.min.y}, pane}, {{x, y}, pane}}},
            .bar = {{x + pane.x, area.min.y}, {bar, area.size.y - row}}};
  }
  const float width = std::max(1.0f, std::floor((area.size.x - bar) / 3.0f - kPaneGap));
  const float top = area.min.y + row;
  const float height = std::max(1.0f, area.size.y - row);
  SliceStrip strip;
  strip.row = {area.min, {area.size.x, row}};
  for (std::size_t n = 0; n < strip.slices.size(); ++n) {
    strip.slices[n] = {{area.min.x + static_cast<float>(n) * (width + kPaneGap), top},
                       {width, height}};
  }
  const float right = area.min.x + 3.0f * (width + kPaneGap);
  strip.bar = {{right, top}, {std::max(1.0f, area.min.x + area.size.x - right), height}};
  return strip;
}

// The size of an area in whole pixels.
inline ImageSize PixelsOf(const ImVec2& size) {
  const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
  return {std::max(1, static_cast<int>(size.x * scale.x)),
          std::max(1, static_cast<int>(size.y * scale.y))};
}

// The pixel of a point of the screen in the picture that is laid out at `min`.
inline Eigen::Vector2d PixelIn(const ImVec2& min, const Eigen::Vector2d& at) {
  const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
  return {(at.x() - min.x) * scale.x, (at.y() - min.y) * scale.y};
}
inline Eigen::Vector2d PointerIn(const ImVec2& min) {
  const ImVec2 at = ImGui::GetIO().MousePos;
  return PixelIn(min, {at.x, at.y});
}

// A point of the screen, for Dear ImGui.
inline ImVec2 ScreenOf(const Eigen::Vector2d& at) {
  return {static_cast<float>(at.x()), static_cast<float>(at.y())};
}

}  // namespace palpate::view
