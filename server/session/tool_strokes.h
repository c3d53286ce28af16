// What a stylus with a held button does to the volume, read off the samples.
//
//   clutch  (kClutchButton) moves the volume as the stylus moves: translation and
//           turn of the stylus since the press
//   carve   (kCarveButton) takes away what is within a sphere that SCP_H sweeps,
//           at a rate; a negative one adds
// Both in steps of kToolStepNs, and what is left when the button is released. Each
// sample is judged by the scene that its tick used, so that a tool that is switched
// on or a volume that is moved in mid-stroke works from that very tick.
//
// Samples with a fault, or with an orientation that is none, are passed over.
//
// Frames: D (mm) in, W (mm) out for what changes voxels. Threads: none of its own;
// one caller at a time. Not for real-time code.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "server/samples/tick_sample.h"
#include "server/scene/scene.h"

namespace palpate {

// 60 Hz.
inline constexpr std::int64_t kToolStepNs = 16'666'667;

// p -> R p + t, in D.
struct RigidMotion {
  Eigen::Quaterniond R = Eigen::Quaterniond::Identity();
  Vec3 t_mm = Vec3::Zero();

  Vec3 Apply(const Vec3& p_D) const { return R * p_D + t_mm; }
  // (a * b)(p) = a(b(p)).
  friend RigidMotion operator*(const RigidMotion& a, const RigidMotion& b) {
    return {(a.R * b.R).normalized(), a.R * b.t_mm + a.t_mm};
  }
};

// What one step of carving does to the voxels along the way of SCP_H.
struct CarveStep {
  std::uint64_t stroke = 0;           // 1, 2, ...; of one press, on one volume
  std::uint64_t loaded_revision = 0;  // of the volume that was felt
  Vec3 p_WFrom_mm = Vec3::Zero();
  Vec3 p_WTo_mm = Vec3::Zero();
  double radius_mm = 0.0;  // in W; farther away nothing changes
  double value = 0.0;      // data units to add on the way; below 0: to take away
  std::int64_t duration_ns = 0;
};

class ToolStrokes {
 public:
  // Steps of carving that wait to be taken become one, as long as their way is about
  // straight, up to this time: a big brush in a big volume may take longer than a step
  // lasts. Of more than that the oldest are left out, so that carving is never late.
  static constexpr std::int64_t kLongestCarveStepNs = 100'000'000;
  static constexpr std::size_t kMostCarveSteps = 4;

  // Of every scene, before its first sample.
  void OnScene(const Scene& scene);
  // Of every tick, in order. True: there is something to take.
  bool OnSample(const TickSample& sample);

  // The motion of the stylus since the last call; none while it is not due.
  std::optional<RigidMotion> TakeMotion();
  // Oldest first.
  std::vector<CarveStep> TakeCarving();

 private:
  struct Pose {
    Vec3 p_D_mm = Vec3::Zero();
    Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();
  };
  // What the tools need of a scene.
  struct Tools {
    std::uint64_t scene_revision = 0;
    std::uint64_t loaded_revision = 0;
    bool clutch = false;
    bool carve = false;
    double radius_mm = 0.0;    // in W
    double value_per_s = 0.0;  // data units
    AffineMap X_WD;
    std::uint64_t placement = 0;  // another one for another X_WD
  };
  struct Clutch {
    bool held = false;
    Pose from, to;  // what was not made a motion yet
    std::int64_t since_ns = 0;
    RigidMotion pending;
    bool due = false;
  };
  struct Carve {
    bool held = false;
    CarveStep step;  // on its way
    std::uint64_t placement = 0;
    std::int64_t since_ns = 0;
    std::int64_t until_ns = 0;
    double value_per_s = 0.0;
    std::deque<CarveStep> due;
  };

  const Tools* ToolsOf(const TickSample& sample);
  void FollowClutch(bool held, const TickSample& sample);
  void EndMotion();
  void FollowCarve(bool held, const Tools& tools, const TickSample& sample);
  void BeginCarveStep(const Tools& tools, const Vec3& p_W_mm, std::int64_t time_ns);
  void EndCarveStep();

  std::deque<Tools> tools_;  // of scenes that samples may still name, oldest first
  std::uint64_t next_tick_ = 0;
  std::uint64_t strokes_ = 0;
  Clutch clutch_;
  Carve carve_;
};

}  // namespace palpate
