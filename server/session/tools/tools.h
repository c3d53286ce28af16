// Runs the stylus's tools: a thread that moves the volume and changes voxels as the samples tell.
//
// The servo itself suspends the forces, in the same tick in which the clutch's button is pressed.
// The volume follows a moment later, and ends exactly where the stylus was in the last tick with
// the button held.
//
// Threads: OnScene under the session's lock, OnSample on the pump thread. Neither waits for a
// change: the thread started by Start makes the changes.
// One Undo takes back all carving from a press to its release.
// Errors: a refused change is logged, once per stroke.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "server/felt/scene.h"
#include "server/pump/tick_sample.h"
#include "server/session/edits/volume_editor.h"
#include "server/session/session.h"

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

// One step of carving: the change to the voxels along the path of SCP_H, or of a ball of a tool.
struct CarveStep {
  std::uint64_t stroke = 0;           // 1, 2, ...; a new one for each press, volume or tool
  std::uint64_t loaded_revision = 0;  // of the volume that was felt
  Vec3 p_WFrom_mm = Vec3::Zero();     // of SCP_H; of a ball a little ahead, towards HIP
  Vec3 p_WTo_mm = Vec3::Zero();
  double full_mm = 0.0;    // in W; voxels this near to the path change by `value`
  double radius_mm = 0.0;  // in W; voxels farther away do not change
  double value = 0.0;      // data units to add; below 0 removes
  std::int64_t duration_ns = 0;
};

// Derives from the samples what the stylus does to the volume while a button is held.
//
//   clutch  (kClutchButton) moves the volume as the stylus moves: translation and
//           turn of the stylus since the press
//   carve   (kCarveButton) removes material within a sphere that SCP_H sweeps,
//           at a rate; a negative rate adds material. Of a rigid tool, its balls that carve do
// Both tools work in steps of kToolStepNs. The last, shorter step ends when the button is
// released. Each sample is judged by the scene that its tick used: if a tool is switched on or
// the volume is moved in mid-stroke, the change takes effect from that very tick.
//
// Both tools skip samples with a fault. The clutch also skips samples without a valid orientation.
//
// Frames: samples and motions in D (mm); carve steps in W (mm). Threads: none of its own; one
// caller at a time. Not for real-time code.
class ToolStrokes {
 public:
  // Waiting carve steps are joined while their path is about straight and they last at most
  // kLongestCarveStepNs together: a big brush in a big volume may take longer than one step lasts.
  // If more than kMostCarveSteps wait, the oldest are dropped, so that carving is never late.
  static constexpr std::int64_t kLongestCarveStepNs = 100'000'000;
  static constexpr std::size_t kMostCarveSteps = 4;

  // Call it for every scene, before the scene's first sample.
  void OnScene(const Scene& scene);
  // Call it for every tick, in order. Returns true if a motion or a carve step can be taken.
  bool OnSample(const TickSample& sample);

  // Returns the stylus's motion since the last call; none until a step is complete.
  std::optional<RigidMotion> TakeMotion();
  // Returns the waiting carve steps, oldest first.
  std::vector<CarveStep> TakeCarving();

 private:
  struct Pose {
    Vec3 p_D_mm = Vec3::Zero();
    Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();
  };
  // What carves: the tip, or a ball of a rigid tool.
  struct Bur {
    Vec3 p_SBur_mm = Vec3::Zero();
    double full_mm = 0.0, radius_mm = 0.0;  // as in CarveStep
  };
  // The parts of a scene that the tools need.
  struct Tools {
    std::uint64_t scene_revision = 0;
    std::uint64_t loaded_revision = 0;
    bool clutch = false;
    bool carve = false;
    std::vector<Bur> burs;
    double ahead_mm = 0.0;     // in D, from where a bur is towards where it is pressed to
    double value_per_s = 0.0;  // data units
    AffineMap X_WD;
    std::uint64_t placement = 0;  // changes when X_WD, the volume or the burs change
  };
  struct Clutch {
    bool held = false;
    Pose from, to;  // the movement that is not in `pending` yet
    std::int64_t since_ns = 0;
    RigidMotion pending;
    bool due = false;
  };
  // Of one bur.
  struct Carve {
    CarveStep step;  // the step that is growing
    std::int64_t since_ns = 0;
    std::int64_t until_ns = 0;
    std::deque<CarveStep> due;
  };

  const Tools* ToolsOf(const TickSample& sample);
  void FollowClutch(bool held, const TickSample& sample);
  void EndMotion();
  void FollowCarve(bool held, const Tools& tools, const TickSample& sample);
  void FollowBur(const Bur& bur, const Tools& tools, const TickSample& sample, bool begins,
                 Carve& carve) const;
  void BeginCarveStep(const Vec3& p_W_mm, std::int64_t time_ns, Carve& carve) const;
  static void EndCarveStep(Carve& carve);

  std::deque<Tools> tools_;  // of scenes that samples may still name, oldest first
  std::uint64_t next_tick_ = 0;
  std::uint64_t strokes_ = 0;
  Clutch clutch_;
  bool carves_held_ = false;
  std::uint64_t loaded_revision_ = 0;  // of the stroke
  std::uint64_t placement_ = 0;
  std::vector<Carve> carves_;
};

class StylusTools final : public SampleSink, public SceneListener {
 public:
  // Borrows both. Listens to the session: construct it before the first Load.
  StylusTools(Session& session, VolumeEditor& editor) : session_(session), editor_(editor) {}
  ~StylusTools() override { Stop(); }

  void Start();
  // Finishes the work that is due.
  void Stop() noexcept;

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;
  void OnSample(const TickSample& sample) override;

  // Does the work that is due now, for callers without the thread.
  void Work() noexcept;

 private:
  void Run();
  void Move(const RigidMotion& motion);
  void Carve(const CarveStep& step);

  Session& session_;
  VolumeEditor& editor_;
  std::uint64_t failed_stroke_ = 0;
  bool move_failed_ = false;

  std::mutex mutex_;  // guards the members below; not held while the session is called
  std::condition_variable due_;
  ToolStrokes strokes_;
  bool is_due_ = false;
  bool stop_ = false;
  std::thread thread_;
  const Listening listening_{session_, *this};
};

}  // namespace palpate
