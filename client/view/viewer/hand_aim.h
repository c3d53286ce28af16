// Where the pointer leads the hand: a point under the pointer, at a depth.
//
// Pixels of the view from its upper left corner. Frame: D (mm).
// Threads: plain values.
#pragma once

#include <algorithm>
#include <vector>

#include "client/view/viewer/pointer_stroke.h"

namespace palpate::view {

enum class HandWay {
  kSurface,  // along the surface that is seen
  kPlane,    // in the plane across the line of sight
};

struct HandOptions {
  HandWay way = HandWay::kSurface;
  // How far behind the surface the hand wants to be, along the sight. The hand is a spring, so this
  // is how firmly it touches. Negative: before the surface.
  double press_mm = 3.0;
  static constexpr double kLeastPress_mm = -20.0;
  static constexpr double kMostPress_mm = 20.0;

  void Press(double more_mm) {
    press_mm = std::clamp(press_mm + more_mm, kLeastPress_mm, kMostPress_mm);
  }
};

class HandAim {
 public:
  // Where the hand is when it is taken.
  void Begin(const Vec3& hip_D) { target_D_ = plane_D_ = hip_D; }
  const Vec3& target_D() const { return target_D_; }

  // Leads the target to the pointer. `harder_mm` deeper than the options say. Where no surface is
  // under the pointer, the hand stays in the plane of its last place.
  void Follow(const Eigen::Vector2d& at_px, const ImageSize& view, const SeenSurface& seen,
              const HandOptions& options, double harder_mm);
  // Moves the plane away from the eye.
  void Push(double farther_mm, const Camera& camera);

 private:
  Vec3 target_D_ = Vec3::Zero();
  Vec3 plane_D_ = Vec3::Zero();  // a point of the plane; without harder_mm
};

// A ball around the volume.
struct Surroundings {
  Vec3 center_D = Vec3::Zero();
  double radius_mm = 0.0;
};

// The way of a hand to a target that is far away, perhaps on another side: a straight way would
// lead through the volume, and the proxy would stay behind. So the hand goes out of the volume,
// around it, and to the target along the line of sight, where nothing is in between. Corners in
// order; the last one is the target.
std::vector<Vec3> WayAround(const Vec3& from_D, const Vec3& target_D, const Vec3& eye_D,
                            const Surroundings& volume);

// Removes what is gone from a way, and returns where the hand is then.
Vec3 GoAlong(std::vector<Vec3>& way_D, const Vec3& from_D, double length_mm);

}  // namespace palpate::view
