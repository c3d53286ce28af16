// A hand that tries, with the proxy itself, whether the surface can be followed.
//
// What a plan takes from the trilinear density, the proxy may not do: noise has pits that hold
// it, and a wall of less than a voxel bars its way.
//
// Frame D (mm). Threads: one; borrows the surface. Not real-time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "server/haptics/proxy.h"
#include "server/simulated_hand/touch_plan.h"

namespace palpate {

class Rehearsal {
 public:
  explicit Rehearsal(const HapticSurface& surface);

  // The hand comes down on point `from` from above and slides to point `to`. Returns the number of
  // points, that one included, over which the proxy stays with the hand; 0: it did not come down.
  std::size_t Slide(const std::vector<TouchPoint>& points, std::size_t from, std::size_t to);

  // The hand leaves one touch by the arc. Whether the proxy comes to the other one.
  bool Crosses(const TouchPoint& from, const TouchPoint& to, const TouchArc& arc);

  // Of the proxy so far; one of many moves counts more than once.
  std::int64_t steps() const { return steps_; }

 private:
  bool ComeDown(const TouchPoint& point);
  bool Touches(const TouchPoint& point) const;
  void MoveTo(const Vec3& p_D_mm);

  const HapticSurface& surface_;
  std::unique_ptr<CellCache> cache_ = std::make_unique<CellCache>();
  Proxy proxy_;
  Vec3 hand_mm_ = Vec3::Zero();
  std::int64_t steps_ = 0;
};

}  // namespace palpate
