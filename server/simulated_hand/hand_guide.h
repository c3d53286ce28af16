// Shows the simulated hand where the surface is.
//
// One thread, "palpate-hand", makes a plan of touches whenever what is felt has changed: the
// volume, the isovalue, the free side, the method, the placement or the stiffness. The thread runs
// at a lower priority (nice) than the others. It rests between two plans, so that a series of edits
// costs no more than a tenth of a core. It does not rest when another volume has come.
//
// Threads: construct, Start and Stop on the main thread; OnScene and MakeRoomFor on those that
// publish.
// Ownership: borrows the session, as its listener, and the inbox; a volume is held while it is
// planned on. Errors: without memory for a new plan, the hand keeps the last one.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>

#include "server/session/session.h"
#include "server/simulated_hand/touch_planner.h"

namespace palpate {

class HandGuide final : public SceneListener {
 public:
  // Before the first Load.
  HandGuide(Session& session, TouchPlanInbox& plans);
  ~HandGuide() override { Stop(); }

  void Start();
  void Stop() noexcept;

  // Sends the hand to where `surface` has none, and waits until it is there, a second at most.
  void MakeRoomFor(const HapticSurface& surface);

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;

 private:
  // All that a plan depends on.
  struct Felt {
    explicit Felt(const Scene& scene);

    std::shared_ptr<const VolumeSnapshot> volume;
    HapticSurface surface;  // borrows *volume
    double stiffness_n_per_mm;
    bool has_tool = false;
  };

  void Run();
  std::optional<Felt> NextFelt();
  void Plan(const Felt& felt) noexcept;

  const DeviceDescription device_;
  TouchPlanInbox& plans_;

  std::mutex mutex_;  // guards what follows, briefly
  std::condition_variable wake_;
  std::optional<Felt> waiting_;  // for a plan
  // What the newest plan depends on, or the plan to come. The surface is without its volume.
  std::uint64_t newest_revision_ = 0;
  HapticSurface newest_surface_;
  double newest_stiffness_n_per_mm_ = -1.0;
  std::uint64_t loaded_revision_ = 0;
  bool is_other_volume_ = false;  // than that of the newest plan, or of the plan in the making
  // For a volume that has not come yet.
  std::chrono::steady_clock::time_point room_is_made_until_{};
  bool is_running_ = false;
  bool stop_ = false;
  std::thread thread_;

  const Listening listening_;
};

}  // namespace palpate
