// The pointer leads the simulated hand, for who has no device. The pointer's events move the target
// at once: they do not wait for a frame, which may take half a second.
//
// Frame: D (mm). Threads: main.
#pragma once

#include <chrono>
#include <cstdint>
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
  // The pointer's left button went up: the burr stops before the pointer moves on.
  void ButtonReleased(LiveFeed& feed);
  // Changes of the last stroke that carved may still come.
  bool is_carving() const { return carving_.has_value(); }
  // Nobody sees where the hand is, as while the window is iconified.
  void GiveBack(Viewer& viewer);
  // Where the hand wants to be; none: we do not lead it.
  std::optional<Vec3> target_D() const;
  // What it does now, beside following the pointer.
  struct Acts {
    bool presses = false;       // harder
    bool turns = false;         // the stylus turns with the pointer, and the wheel rolls it
    std::uint32_t buttons = 0;  // of the stylus that are held: bit n is button n
    friend bool operator==(const Acts&, const Acts&) = default;
  };
  const Acts& acts() const { return acts_; }
  // The stylus's button 0, and so the pointer's left one, carves what is in the hand's way.
  static bool CanCarve(const LiveFeed& feed);

 private:
  // How places on the screen become targets, until the next frame.
  struct Following {
    Eigen::Vector2d view_min = Eigen::Vector2d::Zero();
    double px_per_unit = 1.0;
    ImageSize view;
    HandOptions options;
    double tip_mm = 0.0;
  };

  void Begin(Viewer& viewer);
  void HoldTool(const LiveFeed& feed);
  void End(Viewer& viewer);
  bool Goes(Viewer& viewer);
  void Act(Viewer& viewer, const ViewPointer& pointer);
  void FollowCarving(Viewer& viewer);
  bool Lead(Viewer& viewer, const ViewPointer& pointer);
  void Resume(const Eigen::Vector2d& at_px, const ImageSize& view);
  void Aim(const Eigen::Vector2d& at_px, LiveFeed& feed);
  void GoToTarget(LiveFeed& feed);
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
  Acts acts_;
  std::uint32_t kept_buttons_ = 0;  // of acts_, without the pointer's
  // A stroke of the stylus that carves, until all its changes have come.
  struct Carving {
    std::uint64_t from = 0, to = 0;  // revisions of the volume
    std::chrono::steady_clock::time_point begun{}, changed{};
    bool ended = false;
    bool is_one = true;  // no other stroke began before its changes had come
  };
  std::optional<Carving> carving_;
  // After the pointer has turned the stylus or the view, the hand stays where it is. When the
  // pointer moves on, the hand goes with it, beside it.
  bool broke_off_ = false;
  Eigen::Vector2d beside_px_ = Eigen::Vector2d::Zero();  // from the pointer to the target
  std::optional<Eigen::Vector2d> rests_px_;              // the pointer, which has not moved since
};

}  // namespace palpate::view
