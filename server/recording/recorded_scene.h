// Scenes of the servo to those of a recording, and back.
//
// Threads: any ordinary one.
#pragma once

#include <memory>

#include "server/recording/recording.h"
#include "server/scene/scene.h"

namespace palpate {

// `hash`: of the scene's volume. safety, device: of the servo.
RecordedScene ToRecorded(const Scene& scene, const VolumeHash& hash, double tick_period_s,
                         const SafetyLimits& safety, const PassivityDevice& device);

// A scene in which a tick gives the bits that were recorded. `hash`: of `volume`.
// Throws Error: kConflict for another volume than the recorded one, or settings
// that this program does not know.
Scene ToScene(const RecordedScene& recorded, std::shared_ptr<const VolumeSnapshot> volume,
              const VolumeHash& hash);

}  // namespace palpate
