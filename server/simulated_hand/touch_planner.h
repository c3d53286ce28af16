// Where the simulated hand is to touch the surface, and the planner of such a tour of strokes.
#pragma once

#include <algorithm>
#include <atomic>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/device/haptic_device.h"
#include "server/realtime/snapshot_handoff.h"
#include "server/simulated_hand/touch_points.h"

namespace palpate {

struct TouchPoint {
  Vec3 p_D_mm = Vec3::Zero();      // on the surface
  Vec3 normal_D = Vec3::UnitZ();   // unit, towards free space
  Vec3 p_DHand_mm = Vec3::Zero();  // where the hand is to be: below the surface
  double speed_mm_s = 0.0;         // of a slide past this point
};

struct TouchStroke {
  std::vector<TouchPoint> points;  // at least one; neighbours are less than a millimetre apart
  double least_s = 0.0;            // the hand stays for so long, going to and fro
  double lift_to_next_mm = 0.0;    // of the way to the next stroke: see TouchArc
};

// Where the simulated hand is to touch the surface, and in which order.
//
// A tour of strokes. The hand enters a stroke at one end, slides along its points,
// leaves at the other end, and goes through free space to the next one. At the end
// of the tour it goes back the same way. So the planner has checked every way between two strokes,
// but not the way to the first one.
//
// All numbers are finite, and no stroke is empty.
//
// Frame D (mm). Threads: plain values; made off the servo thread, read on it.
// Ownership: TouchPlanInbox owns what was published, as SnapshotHandoff says.
struct TouchPlan {
  std::vector<TouchStroke> strokes;  // none: there is nothing to touch
  double stiffness_n_per_mm = 0.0;   // of the surface, for what the hand expects to feel
  // Free places to which a hand goes that is inside the surface.
  std::vector<Vec3> p_DFree_mm{};
  // A rigid tool is held: the stylus's barrel goes along the normals, so that the tool stays free.
  bool turns_stylus = false;
  // Another volume is about to come: the hand goes to a free place of that volume and waits there
  // for its plan. There is at least one free place, and no stroke.
  bool makes_room = false;
};

// The way from one touch to another: a cubic that leaves along one normal and
// arrives along the other.
struct TouchArc {
  Vec3 p_DFrom_mm = Vec3::Zero();
  Vec3 p_DLeaving_mm = Vec3::Zero();
  Vec3 p_DArriving_mm = Vec3::Zero();
  Vec3 p_DTo_mm = Vec3::Zero();

  TouchArc() = default;
  // `lift_mm`: how far the control points stand off.
  TouchArc(const Vec3& p_DFrom, const Vec3& leaving_D, const Vec3& p_DTo, const Vec3& arriving_D,
           double lift_mm)
      : p_DFrom_mm(p_DFrom),
        p_DLeaving_mm(p_DFrom + lift_mm * leaving_D),
        p_DArriving_mm(p_DTo + lift_mm * arriving_D),
        p_DTo_mm(p_DTo) {}

  // s from 0 to 1.
  Vec3 At(double s) const {
    const double r = 1.0 - s;
    return r * r * r * p_DFrom_mm + 3.0 * r * r * s * p_DLeaving_mm +
           3.0 * r * s * s * p_DArriving_mm + s * s * s * p_DTo_mm;
  }
  // Greatest length of the derivative by s.
  double FastestMm() const {
    double fastest_mm = 0.0;
    constexpr int kLooks = 8;
    for (int look = 0; look <= kLooks; ++look) {
      const double s = static_cast<double>(look) / kLooks, r = 1.0 - s;
      const Vec3 derivative = 3.0 * (r * r * (p_DLeaving_mm - p_DFrom_mm) +
                                     2.0 * r * s * (p_DArriving_mm - p_DLeaving_mm) +
                                     s * s * (p_DTo_mm - p_DArriving_mm));
      fastest_mm = std::max(fastest_mm, derivative.norm());
    }
    return fastest_mm;
  }
  // At least the arc's own.
  double LengthMm() const {
    return (p_DLeaving_mm - p_DFrom_mm).norm() + (p_DArriving_mm - p_DLeaving_mm).norm() +
           (p_DTo_mm - p_DArriving_mm).norm();
  }
};

class TouchPlanInbox : public SnapshotHandoff<TouchPlan> {
 public:
  // Set by the hand when it has made room; reset by whoever sends it there.
  std::atomic<bool> is_out{false};
};

// A tour of strokes over the surface, for the simulated hand.
//
// The strokes begin at points all over the surface. Strokes in the open come before those in narrow
// places, and long ones before dust. Their order makes the ways through free space short.
//
// Frame D (mm). Threads: pure; not real-time: tens of milliseconds for the volumes that were tried.
// The same surface gives the same plan, bit for bit.
//
// Empty where the workspace holds no surface. `cost`: what the plan took, where somebody asks.
TouchPlan PlanTouches(const HapticSurface& surface, const DeviceDescription& device,
                      double stiffness_n_per_mm, const GuideBudget& budget = {},
                      GuideCost* cost = nullptr);

}  // namespace palpate
