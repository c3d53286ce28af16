#include "server/session/tools/tools.h"

#include <pthread.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <utility>

#include "server/log/log.h"

namespace palpate {
namespace {

// The most scenes kept when they are published faster than the servo uses them, or while the servo
// stands still.
constexpr std::size_t kMostScenes = 4096;
// Carving by a ball fades out over this beyond the ball, in longest voxel edges.
constexpr double kBeyondBallVoxels = 0.75;
// The values that stop a ball are up to this far beyond it. It carves so much ahead, where it is
// pressed to, and not at its sides.
constexpr double kAheadVoxels = 1.5;
// An orientation is accepted if its norm differs from 1 by at most this.
constexpr double kUnitTolerance = 1e-3;

Vec3 ToVector(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

std::optional<Eigen::Quaterniond> Orientation(const std::array<double, 4>& wxyz) {
  const auto& [w, x, y, z] = wxyz;
  const Eigen::Quaterniond q(w, x, y, z);
  // Also refuses NaN: the comparison is false.
  if (!(std::abs(q.norm() - 1.0) <= kUnitTolerance)) return std::nullopt;
  return q.normalized();
}

// The motion that turns the first pose into the second.
RigidMotion Between(const Vec3& p_from, const Eigen::Quaterniond& R_from, const Vec3& p_to,
                    const Eigen::Quaterniond& R_to) {
  RigidMotion motion;
  motion.R = (R_to * R_from.conjugate()).normalized();
  motion.t_mm = p_to - motion.R * p_from;
  return motion;
}

double DistanceToLine(const Vec3& p, const Vec3& from, const Vec3& to) {
  const Vec3 way = to - from;
  const double length2 = way.squaredNorm();
  const double at = length2 > 0.0 ? std::clamp((p - from).dot(way) / length2, 0.0, 1.0) : 0.0;
  return (from + at * way - p).norm();
}

// Joins `step` to the step before it if this changes the path only a little.
bool Joined(const CarveStep& step, CarveStep& before) {
  constexpr double kStraightness = 0.125;  // of the radius
  if (step.stroke != before.stroke || step.p_WFrom_mm != before.p_WTo_mm ||
      step.radius_mm != before.radius_mm || step.full_mm != before.full_mm ||
      step.duration_ns + before.duration_ns > ToolStrokes::kLongestCarveStepNs ||
      DistanceToLine(before.p_WTo_mm, before.p_WFrom_mm, step.p_WTo_mm) >
          kStraightness * step.radius_mm) {
    return false;
  }
  before.p_WTo_mm = step.p_WTo_mm;
  before.value += step.value;
  before.duration_ns += step.duration_ns;
  return true;
}

}  // namespace

void ToolStrokes::OnScene(const Scene& scene) {
  const VolumeMetadata& metadata = scene.volume->metadata();
  const HapticSettings& settings = scene.settings;
  Tools tools;
  tools.scene_revision = scene.scene_revision;
  tools.loaded_revision = scene.volume->loaded_revision();
  // While forces are off, viewers are shown something else: nobody sees what would move.
  tools.clutch = settings.clutch_tool && !scene.forces_off;
  tools.carve = settings.carve_tool && !scene.forces_off;
  tools.X_WD = metadata.WorldFromIndex() * scene.X_DI().Inverse();
  const double W_from_D = tools.X_WD.linear.col(0).norm();
  const double voxel_mm = scene.surface.longest_voxel_mm;
  const auto bur_of = [&](const Vec3& p_SBur_mm, double ball_mm, double carve_mm) {
    const double beyond_mm = ball_mm > 0.0 ? ball_mm + kBeyondBallVoxels * voxel_mm : 0.0;
    return Bur{p_SBur_mm, W_from_D * std::max(0.5 * carve_mm, ball_mm),
               W_from_D * std::max(carve_mm, beyond_mm)};
  };
  if (scene.tool) {
    for (const HeldToolBall& ball : scene.tool->held.ball) {
      if (ball.carves) tools.burs.push_back(bur_of(ball.center_mm, ball.radius_mm, 0.0));
    }
  } else {
    const double ball_mm = scene.ball ? scene.ball->radius_mm : 0.0;
    tools.burs.push_back(bur_of(Vec3::Zero(), ball_mm, settings.carve_radius_mm));
  }
  if ((scene.ball || scene.tool) && settings.carve_rate_per_s > 0.0) {
    tools.ahead_mm = kAheadVoxels * voxel_mm;
  }
  tools.value_per_s = settings.carve_rate_per_s * (metadata.value_max - metadata.value_min);
  if (!tools_.empty()) {
    const Tools& last = tools_.back();
    const bool has_other_burs =
        !std::ranges::equal(tools.burs, last.burs, {}, &Bur::p_SBur_mm, &Bur::p_SBur_mm);
    const bool same =
        tools.loaded_revision == last.loaded_revision && tools.X_WD == last.X_WD && !has_other_burs;
    tools.placement = last.placement + !same;
  }
  tools_.push_back(tools);
  if (tools_.size() > kMostScenes) tools_.pop_front();
}

const ToolStrokes::Tools* ToolStrokes::ToolsOf(const TickSample& sample) {
  while (tools_.size() > 1 && tools_[1].scene_revision <= sample.scene_revision) {
    tools_.pop_front();
  }
  const bool known = !tools_.empty() && tools_.front().scene_revision == sample.scene_revision;
  return known ? &tools_.front() : nullptr;
}

bool ToolStrokes::OnSample(const TickSample& sample) {
  const Tools* tools = ToolsOf(sample);
  // If samples were lost, a button may have been released and pressed again.
  const bool lost = sample.tick != std::exchange(next_tick_, sample.tick + 1);
  if (lost || !tools) {
    FollowClutch(false, sample);
    FollowCarve(false, Tools(), sample);
  }
  if (tools && sample.mode != ProxyMode::kFault) {
    const bool suspended = sample.mode == ProxyMode::kSuspended;
    FollowClutch(suspended && tools->clutch && (sample.buttons & kClutchButton) != 0, sample);
    FollowCarve(!suspended && tools->carve && (sample.buttons & kCarveButton) != 0, *tools, sample);
  }
  return clutch_.due ||
         std::ranges::any_of(carves_, [](const Carve& carve) { return !carve.due.empty(); });
}

void ToolStrokes::FollowClutch(bool held, const TickSample& sample) {
  if (!held) {
    if (std::exchange(clutch_.held, false)) EndMotion();
    return;
  }
  const std::optional<Eigen::Quaterniond> R_DS = Orientation(sample.stylus_orientation);
  if (!R_DS) return;
  const Pose pose{ToVector(sample.hip_mm), *R_DS};
  if (!std::exchange(clutch_.held, true)) {
    clutch_.from = pose;
    clutch_.since_ns = sample.time_ns;
  }
  clutch_.to = pose;
  if (sample.time_ns - clutch_.since_ns >= kToolStepNs) {
    EndMotion();
    clutch_.since_ns = sample.time_ns;
  }
}

void ToolStrokes::EndMotion() {
  const Pose& from = clutch_.from;
  const Pose& to = clutch_.to;
  if (from.p_D_mm == to.p_D_mm && from.R_DS.coeffs() == to.R_DS.coeffs()) return;
  clutch_.pending = Between(from.p_D_mm, from.R_DS, to.p_D_mm, to.R_DS) * clutch_.pending;
  clutch_.from = to;
  clutch_.due = true;
}

std::optional<RigidMotion> ToolStrokes::TakeMotion() {
  if (!std::exchange(clutch_.due, false)) return std::nullopt;
  return std::exchange(clutch_.pending, RigidMotion());
}

void ToolStrokes::FollowCarve(bool held, const Tools& tools, const TickSample& sample) {
  const bool began = held && !carves_held_;
  const bool moved = carves_held_ && placement_ != tools.placement;
  if (carves_held_ && (!held || moved)) {
    for (Carve& carve : carves_) EndCarveStep(carve);
  }
  carves_held_ = held;
  if (!held) return;
  if (began || loaded_revision_ != tools.loaded_revision) ++strokes_;
  loaded_revision_ = tools.loaded_revision;
  placement_ = tools.placement;
  carves_.resize(std::max(carves_.size(), tools.burs.size()));
  for (std::size_t n = 0; n < tools.burs.size(); ++n) {
    FollowBur(tools.burs[n], tools, sample, began || moved, carves_[n]);
  }
}

void ToolStrokes::FollowBur(const Bur& bur, const Tools& tools, const TickSample& sample,
                            bool begins, Carve& carve) const {
  const auto arm_mm = [&](const std::array<double, 4>& wxyz) {
    return Vec3(Orientation(wxyz).value_or(Eigen::Quaterniond::Identity()) * bur.p_SBur_mm);
  };
  const Vec3 at_mm = ToVector(sample.scp_h_mm) + arm_mm(sample.tool_orientation);
  const Vec3 pressed_mm = ToVector(sample.hip_mm) + arm_mm(sample.stylus_orientation) - at_mm;
  const double share = std::min(1.0, tools.ahead_mm / std::max(pressed_mm.norm(), 1e-9));
  const Vec3 p_W_mm = tools.X_WD.Apply(at_mm + share * pressed_mm);
  if (begins) BeginCarveStep(p_W_mm, sample.time_ns, carve);
  // The stylus feels the values away from its free side as material.
  const double away = sample.free_side == FreeSide::kBelow ? -1.0 : 1.0;
  // After a fault, carves at most for the time of one step.
  const std::int64_t since_ns = std::min(sample.time_ns - carve.until_ns, kToolStepNs);
  carve.step.value += away * tools.value_per_s * (1e-9 * static_cast<double>(since_ns));
  carve.step.full_mm = bur.full_mm;
  carve.step.radius_mm = bur.radius_mm;
  carve.step.p_WTo_mm = p_W_mm;
  carve.until_ns = sample.time_ns;
  if (sample.time_ns - carve.since_ns >= kToolStepNs) {
    EndCarveStep(carve);
    BeginCarveStep(p_W_mm, sample.time_ns, carve);
  }
}

void ToolStrokes::BeginCarveStep(const Vec3& p_W_mm, std::int64_t time_ns, Carve& carve) const {
  carve.step = {.stroke = strokes_,
                .loaded_revision = loaded_revision_,
                .p_WFrom_mm = p_W_mm,
                .p_WTo_mm = p_W_mm};
  carve.since_ns = carve.until_ns = time_ns;
}

void ToolStrokes::EndCarveStep(Carve& carve) {
  carve.step.duration_ns = carve.until_ns - carve.since_ns;
  if (carve.step.value == 0.0) return;
  const bool is_joined = !carve.due.empty() && Joined(carve.step, carve.due.back());
  if (!is_joined) carve.due.push_back(carve.step);
  if (carve.due.size() > kMostCarveSteps) carve.due.pop_front();
  carve.step.value = 0.0;
}

std::vector<CarveStep> ToolStrokes::TakeCarving() {
  std::vector<CarveStep> steps;
  for (Carve& carve : carves_) {
    steps.insert(steps.end(), carve.due.begin(), carve.due.end());
    carve.due.clear();
  }
  return steps;
}

namespace {

// True if the box around the step reaches a voxel: the stylus may carve outside the volume.
bool Touches(const CarveStep& step, const VolumeMetadata& volume) {
  const AffineMap X_IW = volume.WorldFromIndex().Inverse();
  const Vec3 from_I = X_IW.Apply(step.p_WFrom_mm), to_I = X_IW.Apply(step.p_WTo_mm);
  const Vec3 reach = step.radius_mm * X_IW.linear.rowwise().norm();
  const Vec3 low = from_I.cwiseMin(to_I) - reach, high = from_I.cwiseMax(to_I) + reach;
  const Vec3 last = (volume.size - Vec3i::Ones()).cast<double>();
  return (high.array() >= 0.0).all() && (low.array() <= last.array()).all();
}

VolumeEdit ToEdit(const CarveStep& step) {
  VolumeEdit edit;
  edit.shape = CapsuleShape{step.p_WFrom_mm, step.p_WTo_mm, step.full_mm};
  edit.falloff = step.radius_mm - step.full_mm;
  edit.frame = EditFrame::kWorld;
  edit.operation = step.value < 0.0 ? EditOperation::kSubtract : EditOperation::kAdd;
  edit.value = std::abs(step.value);
  return edit;
}

}  // namespace

void StylusTools::Start() {
  thread_ = std::thread([this] { Run(); });
}

void StylusTools::Stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  due_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void StylusTools::OnScene(const Scene& scene, std::span<const BrickChange>) {
  const std::lock_guard lock(mutex_);
  strokes_.OnScene(scene);
}

void StylusTools::OnSample(const TickSample& sample) {
  {
    const std::lock_guard lock(mutex_);
    if (!strokes_.OnSample(sample)) return;
    is_due_ = true;
  }
  due_.notify_one();
}

void StylusTools::Run() {
  pthread_setname_np(pthread_self(), "palpate-tools");
  bool stop = false;
  while (!stop) {
    {
      std::unique_lock lock(mutex_);
      due_.wait(lock, [this] { return stop_ || is_due_; });
      stop = stop_;
    }
    Work();
  }
}

void StylusTools::Work() noexcept {
  std::optional<RigidMotion> motion;
  std::vector<CarveStep> steps;
  {
    const std::lock_guard lock(mutex_);
    is_due_ = false;
    motion = strokes_.TakeMotion();
    steps = strokes_.TakeCarving();
  }
  if (motion) Move(*motion);
  for (const CarveStep& step : steps) Carve(step);
}

void StylusTools::Move(const RigidMotion& motion) {
  try {
    session_.Move([&](const VolumeState& state) {
      const VolumePlace& from = state.registration;
      return MakeVolumePlace(state.volume->metadata(), motion.Apply(from.p_DCenter_mm),
                             motion.R * from.R_DW, from.device_mm_per_volume_mm);
    });
    move_failed_ = false;
  } catch (const std::exception& error) {
    if (!std::exchange(move_failed_, true)) {
      LogWarning("the clutch does not move the volume: {}", error.what());
    }
  }
}

void StylusTools::Carve(const CarveStep& step) {
  if (step.stroke == failed_stroke_) return;
  const VolumeState state = session_.volume();
  // Another volume was loaded in the meantime: the stroke was not meant for it.
  if (state.volume->loaded_revision() != step.loaded_revision) return;
  if (!Touches(step, state.volume->metadata())) return;
  try {
    editor_.Edit(ToEdit(step), {}, {.number = step.stroke});
  } catch (const std::exception& error) {
    failed_stroke_ = step.stroke;
    LogWarning("the stylus does not carve: {}", error.what());
  }
}

}  // namespace palpate
