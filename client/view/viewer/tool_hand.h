// The pointer leads the simulated hand, for who has no device. The pointer's events move the target
// at once: they do not wait for a frame, which may take half a second.
//
// Frame: D (mm). Threads: main.
#pragma once

#include <chrono>
#include <optional>
#include <vector>

#include "client/view/viewer/pointer.h"
#include "client/view/viewer/tools.h"

namespace palpate::view {

class LiveFeed;

class HandTool {
 public:
  // As the tools in tools.h.
  bool Take(Viewer& viewer, const ViewPointer& pointer);
  // The pointer is there now, in pixels of the screen. Called from within its event.
  void PointerMoved(const Eigen::Vector2d& at, LiveFeed& feed);
  // Nobody sees where the hand is, as while the window is iconified.
  void GiveBack(Viewer& viewer);
  // Where the hand wants to be; none: we do not lead it.
  std::optional<Vec3> target_D() const;

 private:
  // How places on the screen become targets, until the next frame.
  struct Following {
    Eigen::Vector2d view_min = Eigen::Vector2d::Zero();
    double px_per_unit = 1.0;
    ImageSize view;
    HandOptions options;
    double harder_mm = 0.0;
  };

  void Begin(Viewer& viewer);
  void HoldTool(const LiveFeed& feed);
  void End(Viewer& viewer);
  bool Goes(Viewer& viewer);
  bool Lead(Viewer& viewer, const ViewPointer& pointer);
  void Aim(const Eigen::Vector2d& at_px, LiveFeed& feed);
  void GoAround(LiveFeed& feed);
  void TurnStylus(const Eigen::Vector2d& by, const ViewPointer& pointer, Viewer& viewer);
  void Send(LiveFeed& feed) const;

  HandAim aim_;
  SeenSurface seen_;  // the surface of the last picture
  std::uint64_t seen_version_ = 0;
  bool leads_ = false;
  Vec3 sent_D_ = Vec3::Zero();
  // How the hand turns the stylus; none: it turns by itself, as long as nobody turns it.
  std::optional<Eigen::Quaterniond> R_DS_;
  // The corners of the way that the hand still has to go. Empty: it follows the pointer.
  std::vector<Vec3> way_D_;
  std::chrono::steady_clock::time_point gone_at_{};
  std::optional<Eigen::Vector2d> newest_;  // where the pointer was last, on the screen
  std::optional<Following> following_;     // none: the pointer is not on the view, or turns it
};

}  // namespace palpate::view
