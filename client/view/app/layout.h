// The places of the panels. They are fixed, so that users and tests find them again.
//
// Pixels of the screen from its upper left corner. Threads: pure.
#pragma once

#include <imgui.h>

#include <algorithm>

#include "client/view/scene/camera.h"

namespace palpate::view {

struct Area {
  ImVec2 min;
  ImVec2 size;
};

struct Layout {
  Area top;
  Area left;
  Area right;
  Area state;  // above the view
  Area view;
  Area series;  // below the view, if there is a series
  Area slices;  // below the series
};

struct LayoutParts {
  bool panels = true;
  bool series = false;
  bool slices = true;
};

// `scale`: 1 on screens of about 100 pixels per inch.
inline Layout LayOut(const ImVec2& screen, float scale, const LayoutParts& parts) {
  const float top = 40.0f * scale;
  const float side = parts.panels ? std::min(300.0f * scale, screen.x / 3.0f) : 0.0f;
  const float middle = std::max(1.0f, screen.x - 2.0f * side);
  // A slice is about as wide as it is high.
  const float slices =
      parts.panels && parts.slices ? std::min(middle / 3.0f, screen.y / 3.0f) : 0.0f;
  const float series = parts.series ? 44.0f * scale : 0.0f;
  const float height = std::max(1.0f, screen.y - top);
  const float state = 32.0f * scale;
  const float view = std::max(1.0f, height - state - slices - series);
  Layout layout;
  layout.top = {{0.0f, 0.0f}, {screen.x, top}};
  layout.left = {{0.0f, top}, {side, height}};
  layout.right = {{screen.x - side, top}, {side, height}};
  layout.state = {{side, top}, {middle, state}};
  layout.view = {{side, top + state}, {middle, view}};
  layout.series = {{side, top + state + view}, {middle, series}};
  layout.slices = {{side, top + state + view + series}, {middle, slices}};
  return layout;
}

// The size of an area in whole pixels.
inline ImageSize PixelsOf(const ImVec2& size) {
  const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
  return {std::max(1, static_cast<int>(size.x * scale.x)),
          std::max(1, static_cast<int>(size.y * scale.y))};
}

}  // namespace palpate::view
