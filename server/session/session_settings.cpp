// A session's settings: from the start, changed, and taken back.
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "server/session/held_tool.h"
#include "server/session/layers.h"
#include "server/session/range.h"
#include "server/session/session.h"

namespace palpate {

bool Session::SetInitial(const RenderSettings& settings) {
  HapticSettings haptics = settings.haptics;
  CheckHaptics({}, haptics);
  CheckSide(haptics.layers, haptics.free_side);
  CheckHeld(haptics, device_);
  const std::lock_guard lock(mutex_);
  if (settings_revision_ > 0) return false;
  settings_.haptics = std::move(haptics);
  return true;
}

void Session::RequireRevision(const std::optional<std::uint64_t>& expected) const {
  if (!expected || *expected == settings_revision_) return;
  throw Error(ErrorKind::kConflict,
              fmt::format("the settings are at revision {}, not {}: read them again",
                          settings_revision_, *expected));
}

void Session::TakeBack(const RenderSettings& before, std::uint64_t revision) {
  const std::lock_guard lock(mutex_);
  if (settings_revision_ != revision) return;
  if (settings_.haptics.method != before.haptics.method) ++geometry_revision_;
  settings_ = before;
  ++settings_revision_;
  PublishLocked();
}

SettingsApplied Session::Update(const SettingsUpdate& update) {
  if (update.isovalue || update.normalized_isovalue || update.layers) first_load_.Require();
  RequireServo();
  CheckRoom(update);
  SettingsApplied result;
  RenderSettings before;
  std::uint64_t scene_revision = 0;
  {
    const std::lock_guard lock(mutex_);
    RequireNoReplay();
    RequireRevision(update.expected_revision);
    const RenderSettings changed = Changed(*volume_, settings_, update);
    CheckSide(changed.haptics.layers, changed.haptics.free_side);
    if (update.layers) CheckLayers(changed.haptics.layers, volume_->metadata());
    CheckHeld(changed.haptics, device_);
    if (has_volume_ && update.NamesTip()) {
      const std::string refusal = RefusalOfTip(changed.haptics, X_DI_);
      if (!refusal.empty()) throw RangeError(update.tool ? "tool" : "tool_radius_mm", refusal);
      ball_maker_.ForgetProblem();
    }
    // Another decomposition makes another surface for the proxy.
    if (changed.haptics.method != settings_.haptics.method) ++geometry_revision_;
    before = std::exchange(settings_, changed);
    ++settings_revision_;
    PublishLocked();
    result.state = {.settings = settings_, .settings_revision = settings_revision_};
    scene_revision = scene_revision_;
  }
  try {
    result.applied = WaitForServo(scene_revision);
  } catch (const Error&) {
    TakeBack(before, result.state.settings_revision);
    throw;
  }
  return result;
}

}  // namespace palpate
