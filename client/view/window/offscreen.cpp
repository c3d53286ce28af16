#include "client/view/window/png_file.h"
#include "client/view/window/run.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>

#include "client/program/interrupt.h"
#include "client/view/panels/interface.h"
#include "client/view/render/frame_target.h"
#include "client/view/render/offscreen_context.h"
#include "client/view/viewer/viewer.h"
#include "common/arguments/arguments.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kRunFrame(16);
constexpr std::chrono::milliseconds kRunBrickTime(100);
// The longest wait for volume and poses, and again for the stylus to touch.
constexpr std::chrono::seconds kPatience(60);
constexpr std::chrono::seconds kSayLoading(5);
// A palpated that is just being started is there by then.
constexpr std::chrono::seconds kStart(2);
// After this many frames, Dear ImGui knows the sizes of everything that it lays out.
constexpr int kPanelFrames = 3;

void StopIfInterrupted() {
  if (Interrupt::IsRaised()) throw Error(ErrorKind::kCancelled, "cancelled");
}

std::string WhatIsMissing(const Viewer& viewer) {
  const LiveFeed& feed = viewer.feed();
  if (feed.connection().state != client::ConnectionState::kConnected) return feed.connection().why;
  const client::VolumeStatus status = feed.volume_status();
  if (!status.problem.empty()) return "the volume does not come: " + status.problem;
  if (!status.complete) {
    return fmt::format("the volume did not come within {} s, {} bricks are missing",
                       kPatience.count(), status.bricks_left);
  }
  return fmt::format("no poses came within {} s", kPatience.count());
}

// Updates until `holds` returns true. Returns false after kPatience, in which palpated does not
// load its first volume.
template <typename Condition>
bool Await(Viewer& viewer, const Condition& holds) {
  auto end = Clock::now() + kPatience;
  auto said = Clock::time_point();
  while (true) {
    viewer.Update(kRunBrickTime);
    if (holds()) return true;
    const client::VolumeStatus status = viewer.feed().volume_status();
    if (status.is_loading) end = Clock::now() + kPatience;
    if (status.is_loading && Clock::now() - said > kSayLoading) {
      said = Clock::now();
      fmt::print(stderr, "palpated: {}\n", status.problem);
    }
    StopIfInterrupted();
    if (Clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

void AwaitScene(Viewer& viewer, const Options& options) {
  const LiveFeed& feed = viewer.feed();
  // If the daemon is absent at the start, do not wait for it.
  const auto absent_from = Clock::now() + kStart;
  const bool here = Await(viewer, [&] {
    const bool is_lost = feed.connection().state == client::ConnectionState::kLost;
    return viewer.complete() || (is_lost && Clock::now() > absent_from) ||
           !viewer.volume_problem().empty() || !viewer.option_problem().empty();
  });
  if (const std::string& problem = viewer.option_problem(); !problem.empty()) {
    throw arguments::UsageError(problem);
  }
  if (const std::string problem = viewer.volume_problem(); !problem.empty()) {
    throw Error(ErrorKind::kTooLarge, problem);
  }
  if (!here || !viewer.complete()) {
    throw Error(ErrorKind::kUnavailable, WhatIsMissing(viewer));
  }
  if (!options.wait_contact) return;
  const auto touches = [&] {
    const std::optional<client::Pose>& pose = feed.pose();
    if (!pose || !pose->contact) return false;
    // A tool has no SCP_V.
    if (pose->tool_orientation) return options.wait_gap_mm == 0.0;
    return pose->scp_v_mm && (*pose->scp_v_mm - pose->scp_h_mm).norm() >= options.wait_gap_mm;
  };
  if (!Await(viewer, touches)) {
    throw Error(
        ErrorKind::kFailedPrecondition,
        fmt::format("the stylus did not touch{} within {} s",
                    options.wait_gap_mm > 0.0 ? " with such a gap" : "", kPatience.count()));
  }
}

class Offscreen {
 public:
  Offscreen(const Options& options, Viewer& viewer) : options_(options), viewer_(viewer) {
    if (!options.panels) return;
    interface_ = std::make_unique<Interface>(1.0f);
    target_.Resize(options.size);
    ImGuiIO& io = ImGui::GetIO();
    io.DisplaySize = {static_cast<float>(options.size.width),
                      static_cast<float>(options.size.height)};
    io.DeltaTime = 1.0f / 60.0f;
  }

  void DrawFrames(FrameLog& log) {
    const int most = options_.seconds > 0.0 ? 0 : std::max(1, options_.frames);
    while (!Interrupt::IsRaised()) {
      const auto frame = Clock::now();
      // The first frame shows the state that was waited for.
      if (log.frames() > 0) viewer_.Update(kRunBrickTime);
      RequireConnection();
      log.Add(viewer_);
      DrawFrame();
      if (most > 0 ? log.frames() >= most : log.seconds() >= options_.seconds) break;
      std::this_thread::sleep_until(frame + kRunFrame);
    }
  }

  Image Read() {
    if (!interface_) return viewer_.renderer().ReadBack();
    for (int i = 1; i < kPanelFrames; ++i) DrawFrame();
    return {.size = options_.size, .rgba = target_.ReadColors()};
  }

 private:
  // Throws if the connection is lost: the picture would be out of date.
  void RequireConnection() const {
    const client::Connection connection = viewer_.feed().connection();
    if (connection.state == client::ConnectionState::kConnected) return;
    throw Error(ErrorKind::kUnavailable, connection.why);
  }

  void DrawFrame() {
    if (!interface_) {
      viewer_.DrawFine(options_.size);
      return;
    }
    do {
      interface_->DrawFrame(viewer_, {}, options_.size, target_.framebuffer());
    } while (viewer_.TakeUpWanted());
  }

  const Options& options_;
  Viewer& viewer_;
  std::unique_ptr<Interface> interface_;  // null: the view without panels
  FrameTarget target_;                    // of the panels
};

}  // namespace

void RunOffscreen(const Options& options) {
  const IfThere if_there = ReplacesIf(options.overwrite);
  if (!options.screenshot.empty()) CheckNewFile(options.screenshot, if_there);
  const OffscreenContext context;
  Viewer viewer(options);
  viewer.AwaitWhole();
  AwaitScene(viewer, options);
  // Aim at the stylus as it is now.
  viewer.Aim();
  Offscreen offscreen(options, viewer);
  FrameLog log;
  offscreen.DrawFrames(log);
  StopIfInterrupted();
  fmt::print("{}\n", log.Line(viewer));
  if (const std::string problem = viewer.memory_problem(); !problem.empty()) {
    fmt::print(stderr, "palpate-view: {}\n", problem);
  }
  if (!options.screenshot.empty()) {
    WritePng(offscreen.Read(), options.screenshot, if_there);
    fmt::print("{}: {} x {} pixels\n", options.screenshot, options.size.width, options.size.height);
  }
  std::fflush(stdout);
}

}  // namespace palpate::view
