#include "server/session/shown.h"

#include <utility>

#include "server/session/session.h"

namespace palpate {

SettingsState Shown::settings() const {
  if (const auto scene = replayed()) return {scene->settings, scene->settings_revision, true};
  return session_.settings();
}

BallState Shown::ball() const {
  if (const auto scene = replayed()) return scene->ball;
  return session_.ball();
}

VolumeState Shown::volume() const {
  // First: at its end, the session's volume has its new revision before the replay is gone.
  const auto scene = replayed();
  VolumeState state = session_.volume();
  if (scene) {
    state.volume = scene->volume;
    state.registration = scene->place;
    state.X_DI = scene->X_DI;
    state.settings_revision = scene->settings_revision;
    state.isovalue = scene->settings.isovalue;
    state.replayed = true;
  }
  return state;
}

std::shared_ptr<const ShownScene> Shown::replayed() const {
  const std::lock_guard lock(mutex_);
  return replayed_;
}

void Shown::Replace(std::shared_ptr<const ShownScene> scene) {
  const ShownScene* const now = scene.get();
  {
    const std::lock_guard lock(mutex_);
    replayed_.swap(scene);
  }
  if (on_replace_) on_replace_(now);
}

}  // namespace palpate
