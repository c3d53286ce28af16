// A view that the user has given a name: the look at the volume, what is cut away, the window of
// the values, and the cross-hair.
//
// Frames: W (mm), so that a view stays with the volume wherever it is placed; U what the camera
// keeps upright; I voxels. Threads: pure functions.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/view_options.h"

namespace palpate::view {

struct SavedView {
  std::string name{};
  Vec3 target_W = Vec3::Zero();
  Mat3 R_WU = Mat3::Identity();
  double azimuth_deg = 0.0;
  double elevation_deg = 0.0;
  double distance_mm = 1.0;  // of the volume
  CropBox crop{};
  std::array<ClipPlane, 2> planes{};
  double window_min = 0.0;
  double window_max = 1.0;
  Vec3 cross_I = Vec3::Zero();
  std::int64_t saved_s = 0;  // when, in seconds since 1970; 0: not known
  friend bool operator==(const SavedView&, const SavedView&) = default;
};

// `X_DW`: the volume's place, a similarity. Does not set saved_s.
SavedView SaveView(std::string name, const Camera& camera, const SurfaceOptions& surface,
                   const Vec3& cross_I, const AffineMap& X_DW);
void ShowView(const SavedView& view, const AffineMap& X_DW, Camera& camera, SurfaceOptions& surface,
              Vec3& cross_I);

// As JSON, to be kept in a file.
std::string JsonOf(const std::vector<SavedView>& views);
// The views of such a text. Leaves out what is damaged.
std::vector<SavedView> ViewsOf(std::string_view json);

}  // namespace palpate::view
