#include "server/session/tools/tools.h"
#include "server/log/log.h"

#include <pthread.h>

#include <cmath>
#include <exception>
#include <utility>

namespace palpate {
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
