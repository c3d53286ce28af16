#include "client/view/viewer/tool_hand.h"

#include <imgui.h>

#include <algorithm>
#include <utility>

#include "client/view/viewer/viewer.h"

namespace palpate::view {
namespace {

constexpr double kPressPerStep_mm = 0.5;
constexpr double kPushPerStep_mm = 1.0;
// While the left button is held.
constexpr double kHarder_mm = 5.0;
// A target that jumps farther is reached around the volume.
constexpr double kJump_mm = 40.0;
constexpr double kAround_mm_per_s = 300.0;
constexpr double kTurnPerPixel_rad = 0.006;
constexpr double kRollPerStep_rad = 0.1;

constexpr std::uint32_t kCarveButton = 1U << 0;

// How far the ball or the tool reaches beyond the stylus's tip, which the pointer leads.
double TipReach_mm(const LiveFeed& feed) {
  const auto& settings = feed.settings();
  if (!settings || settings->tool.ball.empty())
    return feed.pose() ? feed.pose()->tool_radius_mm : 0;
  double reach_mm = 0.0;
  for (const HeldToolBall& ball : settings->tool.ball) {
    reach_mm = std::max(reach_mm, ball.radius_mm - ball.center_mm.z());
  }
  return reach_mm;
}

Surroundings SurroundingsOf(const ViewVolume& volume) {
  if (!volume.lattice() || !volume.X_DI()) return {};
  const Vec3 last_I = volume.lattice()->size.cast<double>() - Vec3::Ones();
  return {.center_D = volume.X_DI()->Apply(0.5 * last_I),
          .radius_mm = 0.5 * (volume.X_DI()->linear * last_I).norm()};
}

// Why the hand cannot be led; empty: it can.
std::string Obstacle(const LiveFeed& feed) {
  if (feed.connection().state != client::ConnectionState::kConnected || !feed.pose()) {
    return "the stylus can be taken when palpated is connected";
  }
  const client::Hand* daemon = feed.device();
  if (daemon && daemon->device.kind != "simulated") {
    return "the pointer leads the simulated stylus only; this is a " + daemon->device.model;
  }
  if (feed.is_replay() || feed.replayer().position())
    return "the stylus can be taken when no recording is replayed";
  if (!feed.May(client::Role::kOperator)) return "to take the stylus needs the role operator";
  return {};
}

}  // namespace

std::optional<Vec3> HandTool::target_D() const {
  return leads_ ? std::optional<Vec3>(aim_.target_D()) : std::nullopt;
}

bool HandTool::CanCarve(const LiveFeed& feed) {
  const auto& settings = feed.settings();
  if (!settings || !settings->carve_tool) return false;
  const auto& balls = settings->tool.ball;
  return balls.empty() || std::ranges::any_of(balls, &HeldToolBall::carves);
}

bool HandTool::Take(Viewer& viewer, const ViewPointer& pointer) {
  following_.reset();
  FollowCarving(viewer);
  if (viewer.state().tool != Tool::kHand) {
    if (leads_) End(viewer);
    return false;
  }
  if (!leads_) Begin(viewer);
  if (!leads_ || !Goes(viewer)) return false;
  HoldTool(viewer.feed());
  Act(viewer, pointer);
  const bool used = Lead(viewer, pointer);
  GoAround(viewer.feed());
  return used;
}

void HandTool::Begin(Viewer& viewer) {
  LiveFeed& feed = viewer.feed();
  if (const std::string obstacle = Obstacle(feed); !obstacle.empty()) {
    viewer.Say(obstacle);
    viewer.state().tool = Tool::kTurn;
    return;
  }
  feed.TakeHand();
  aim_.Begin(feed.pose()->hip_mm);
  viewer.state().hand.kept_buttons = 0;
  viewer.state().hand.turns = false;
  acts_ = {};
  broke_off_ = false;
  beside_px_.setZero();
  rests_px_.reset();
  sent_D_ = aim_.target_D();
  R_DS_.reset();
  HoldTool(feed);
  Send(feed);
  way_D_.clear();
  seen_ = {};
  leads_ = true;
}

// A tool stays as it is held: by itself it would sway into what is around it.
void HandTool::HoldTool(const LiveFeed& feed) {
  if (R_DS_ || !feed.pose() || !feed.pose()->tool_orientation) return;
  R_DS_ = Eigen::Quaterniond(feed.pose()->stylus_orientation).normalized();
}

void HandTool::GiveBack(Viewer& viewer) {
  if (!leads_) return;
  End(viewer);
  viewer.state().tool = Tool::kTurn;
}

void HandTool::End(Viewer& viewer) {
  viewer.feed().GiveHandBack();
  leads_ = false;
  acts_ = {};
}

// False if the hand is not ours any more. The user must take it again, because meanwhile somebody
// else may have.
bool HandTool::Goes(Viewer& viewer) {
  const client::HandLead* hand = viewer.feed().hand();
  // The live hand would go on over the recorded picture.
  if (viewer.feed().is_replay() || viewer.feed().replayer().position()) {
    viewer.Say("the stylus is given back: a recording is replayed");
    GiveBack(viewer);
    return false;
  }
  if (hand && hand->state() != client::HandLeadState::kEnded) return true;
  viewer.Say(hand ? "the stylus is given back: " + hand->problem() : "the stylus is given back");
  GiveBack(viewer);
  return false;
}

// The left button carves if that is what the stylus's button does; else it presses harder.
void HandTool::Act(Viewer& viewer, const ViewPointer& pointer) {
  HandOptions& options = viewer.state().hand;
  // Whoever stops the forces stops the burr.
  const auto& pose = viewer.feed().pose();
  if (pose && pose->forces.state == client::ForceState::kStopped) options.kept_buttons = 0;
  kept_buttons_ = options.kept_buttons;
  const bool left = pointer.held && !pointer.shift;
  const bool carves = CanCarve(viewer.feed());
  const bool turns_view = ImGui::IsItemActive() && !left;
  const Acts before = acts_;
  acts_ = {.presses = left && !carves,
           .turns = pointer.hovered && !turns_view && (ImGui::GetIO().KeyAlt || options.turns),
           .buttons = options.kept_buttons | (left && carves ? kCarveButton : 0U)};
  aim_.PressHarder(acts_.presses ? kHarder_mm : 0.0);
  FollowCarving(viewer);
  if (acts_ != before) GoToTarget(viewer.feed());
}

// So that what the hand carves can be undone here, as the brush's strokes can.
void HandTool::FollowCarving(Viewer& viewer) {
  constexpr std::chrono::milliseconds kSettled(400);  // longer than carving comes late
  const auto& revision = viewer.feed().volume().revision();
  // Then other changes come between, which this viewer must not undo.
  const bool is_other = viewer.feed().is_replay() || viewer.stroke().has_pointer() ||
                        (carving_ && !viewer.feed().hand());
  if (!revision || is_other) return carving_.reset();
  const std::uint64_t newest = revision->volume_revision;
  const auto now = std::chrono::steady_clock::now();
  const bool carves = (acts_.buttons & kCarveButton) != 0 && CanCarve(viewer.feed());
  if (carving_) {
    if (carving_->to != newest) carving_->changed = now;
    carving_->to = newest;
    if (!carves && !std::exchange(carving_->ended, true)) carving_->changed = now;
    // Two strokes that cannot be told apart are two steps of palpated's: neither is undone here.
    if (carves && carving_->ended) carving_->is_one = false;
    if (carves || now - carving_->changed <= kSettled) return;
    if (carving_->is_one && carving_->to != carving_->from) {
      viewer.brush().Carved(carving_->from, carving_->to, carving_->begun,
                            viewer.feed().commands());
    }
    carving_.reset();
  }
  if (carves) carving_ = {.from = newest, .to = newest, .begun = now, .changed = now};
}

bool HandTool::Lead(Viewer& viewer, const ViewPointer& pointer) {
  HandOptions& options = viewer.state().hand;
  ImGuiIO& io = ImGui::GetIO();
  const bool left = pointer.held && !pointer.shift;
  if (!pointer.hovered && !left) {
    // Where it comes back, the hand comes to it.
    broke_off_ = false;
    beside_px_.setZero();
    rests_px_.reset();
    return false;
  }
  if (acts_.turns) {
    broke_off_ = true;
    TurnStylus({io.MouseDelta.x, io.MouseDelta.y}, pointer, viewer);
    ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeAll);
    return left || pointer.wheel_steps != 0.0;
  }
  if (ImGui::IsItemActive() && !left) {
    broke_off_ = true;
    return false;
  }
  const bool zooms = pointer.shift || io.KeyCtrl;
  if (!zooms) {
    if (options.way == HandWay::kSurface)
      options.Press(kPressPerStep_mm * pointer.wheel_steps);
    else
      aim_.Push(kPushPerStep_mm * pointer.wheel_steps, viewer.state().camera);
  }
  // Read only if it is another one: that costs more than a frame in which the surface stays.
  const std::uint64_t version = viewer.renderer().surface_version();
  if (version != seen_version_ || seen_.size.width == 0) {
    seen_ = viewer.seen_surface();
    seen_version_ = version;
  }
  const double scale = io.DisplayFramebufferScale.x;
  const Eigen::Vector2d at(io.MousePos.x, io.MousePos.y);
  following_ = {.view_min = at - pointer.at_px / scale,
                .px_per_unit = scale,
                .view = pointer.size,
                .options = options,
                .tip_mm = TipReach_mm(viewer.feed())};
  // The pointer may already be farther than Dear ImGui knows.
  const Eigen::Vector2d at_px =
      newest_ ? Eigen::Vector2d((*newest_ - following_->view_min) * scale) : pointer.at_px;
  if (std::exchange(broke_off_, false)) Resume(at_px, pointer.size);
  if (rests_px_ != at_px || pointer.wheel_steps != 0.0) Aim(at_px, viewer.feed());
  // The hand itself is the cursor: it lags behind where the surface resists.
  ImGui::SetMouseCursor(ImGuiMouseCursor_None);
  return left || (pointer.wheel_steps != 0.0 && !zooms);
}

void HandTool::Resume(const Eigen::Vector2d& at_px, const ImageSize& view) {
  const auto target_px = Projection(seen_.camera, view).PixelOf(aim_.target_D());
  beside_px_ = target_px ? Eigen::Vector2d(*target_px - at_px) : Eigen::Vector2d::Zero();
  rests_px_ = at_px;
}

void HandTool::ButtonReleased(LiveFeed& feed) {
  if (!leads_ || (acts_.buttons & ~kept_buttons_) == 0) return;
  acts_.buttons = kept_buttons_;
  Send(feed);
}

void HandTool::PointerMoved(const Eigen::Vector2d& at, LiveFeed& feed) {
  newest_ = at;
  if (!following_ || !feed.hand()) return;
  const Eigen::Vector2d at_px = (at - following_->view_min) * following_->px_per_unit;
  if (at_px.minCoeff() < 0.0 || at_px.x() >= following_->view.width ||
      at_px.y() >= following_->view.height)
    return;
  Aim(at_px, feed);
}

void HandTool::Aim(const Eigen::Vector2d& at_px, LiveFeed& feed) {
  rests_px_.reset();
  aim_.Follow(at_px + beside_px_, following_->view, seen_, following_->options, following_->tip_mm);
  GoToTarget(feed);
}

void HandTool::GoToTarget(LiveFeed& feed) {
  const Vec3 target_D = aim_.target_D();
  if (way_D_.empty() && feed.pose() && (target_D - sent_D_).norm() > kJump_mm) {
    sent_D_ = feed.pose()->scp_h_mm;
    way_D_ = WayAround(sent_D_, target_D, seen_.camera.Eye(), SurroundingsOf(feed.volume()));
    gone_at_ = std::chrono::steady_clock::now();
  }
  if (!way_D_.empty()) return;
  sent_D_ = target_D;
  Send(feed);
}

void HandTool::Send(LiveFeed& feed) const { feed.hand()->MoveTo(sent_D_, acts_.buttons, R_DS_); }

// As the pointer moves on the screen, the barrel's end follows it; the wheel rolls the stylus.
void HandTool::TurnStylus(const Eigen::Vector2d& by, const ViewPointer& pointer, Viewer& viewer) {
  LiveFeed& feed = viewer.feed();
  const double roll_steps = pointer.wheel_steps;
  if (!feed.pose() || (by.isZero() && roll_steps == 0.0)) return;
  if (!R_DS_) R_DS_ = Eigen::Quaterniond(feed.pose()->stylus_orientation).normalized();
  const Mat3 R_DV = Projection(viewer.state().camera, pointer.size).R_DV();
  const Vec3 turn_rad = kTurnPerPixel_rad * (by.x() * R_DV.col(1) + by.y() * R_DV.col(0)) +
                        kRollPerStep_rad * roll_steps * (*R_DS_ * Vec3::UnitZ());
  *R_DS_ = (Eigen::AngleAxisd(turn_rad.norm(), turn_rad.normalized()) * *R_DS_).normalized();
  Send(feed);
}

// A part of the way in each frame. A slow frame is not made up for: the hand would cut corners.
void HandTool::GoAround(LiveFeed& feed) {
  constexpr double kLongest_s = 0.1;
  const auto now = std::chrono::steady_clock::now();
  const double frame_s = std::chrono::duration<double>(now - gone_at_).count();
  gone_at_ = now;
  if (way_D_.empty()) return;
  way_D_.back() = aim_.target_D();
  sent_D_ = GoAlong(way_D_, sent_D_, kAround_mm_per_s * std::min(frame_s, kLongest_s));
  Send(feed);
}

}  // namespace palpate::view
