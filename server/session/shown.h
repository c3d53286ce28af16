// What viewers are shown: the session, or in its place a recording that is replayed. A replay
// changes nothing of the session.
//
// A service that tells clients what there is reads it here. A service that changes something uses
// the session.
//
// Threads: any ordinary thread. Errors: none.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>

#include "common/contract/render.h"
#include "server/felt/registration.h"
#include "server/felt/scene.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

class Session;
struct SettingsState;
struct VolumeState;

// What one recorded scene shows.
struct ShownScene {
  RenderSettings settings{};
  std::uint64_t settings_revision = 0;  // goes on from the session's
  BallState ball{};
  // Of the session's volume as it was then. Its revisions go on from the session's.
  std::shared_ptr<const VolumeSnapshot> volume{};
  VolumePlace place{};
  AffineMap X_DI{};
};

class Shown {
 public:
  // Called after each Replace; null: the session is shown. Must not block or call Replace.
  using OnReplace = std::function<void(const ShownScene* scene)>;

  // Borrows the session.
  explicit Shown(const Session& session) : session_(session) {}

  SettingsState settings() const;
  BallState ball() const;
  VolumeState volume() const;

  // Null: the session is shown.
  std::shared_ptr<const ShownScene> replayed() const;
  // Called by the replay.
  void Replace(std::shared_ptr<const ShownScene> scene);
  // Set it before the first replay. It must stay valid until the last one has ended.
  void SetOnReplace(OnReplace call) { on_replace_ = std::move(call); }

 private:
  const Session& session_;
  OnReplace on_replace_;
  mutable std::mutex mutex_;  // guards replayed_
  std::shared_ptr<const ShownScene> replayed_;
};

}  // namespace palpate
