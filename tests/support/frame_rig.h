// A frame renderer with its context and a volume. Returns pixels of its pictures.
//
// Pixels from the upper left corner.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>

#include "client/view/render/frame_renderer.h"
#include "client/view/render/offscreen_context.h"
#include "tests/support/view_volumes.h"

namespace palpate::testing {

using Rgb8 = std::array<int, 3>;

inline Rgb8 PixelOf(const view::Image& image, int x_px, int y_px) {
  const std::size_t at = 4 * (static_cast<std::size_t>(y_px) * image.size.width + x_px);
  return {image.rgba[at], image.rgba[at + 1], image.rgba[at + 2]};
}

inline int Difference(const Rgb8& a, const Rgb8& b) {
  return std::abs(a[0] - b[0]) + std::abs(a[1] - b[1]) + std::abs(a[2] - b[2]);
}

class FrameRig {
 public:
  void Take(const client::VolumeUpdate& update) {
    volume.Take(update);
    TakeUp();
  }
  // With all bricks that the picture wants.
  view::Image Draw(const view::FrameRequest& request) {
    DrawWhole([&] { renderer.Draw(request); });
    return renderer.ReadBack();
  }
  unsigned DrawSlice(const view::SliceRequest& request) {
    unsigned texture = 0;
    DrawWhole([&] { texture = renderer.DrawSlice(request); });
    return texture;
  }

  view::OffscreenContext context;
  view::FrameRenderer renderer;
  view::ViewVolume volume;

 private:
  void TakeUp() {
    while (!renderer.TakeUp(volume, 1000)) {
    }
  }
  template <typename DrawOnce>
  void DrawWhole(const DrawOnce& draw) {
    std::uint64_t before = 0;
    do {
      before = renderer.volume_version();
      draw();
      TakeUp();
    } while (renderer.volume_version() != before);
  }
};

}  // namespace palpate::testing
