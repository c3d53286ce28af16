// Converts scenes of the servo to recorded scenes and back.
//
// Threads: any ordinary one.
#pragma once

#include <memory>

#include "server/felt/felt_tip.h"
#include "server/felt/scene.h"
#include "server/recording/recording.h"

namespace palpate {

// `hash`: the hash of the scene's volume. `safety`, `device`: the servo's.
RecordedScene ToRecorded(const Scene& scene, const VolumeHash& hash, double tick_period_s,
                         const SafetyLimits& safety, const PassivityDevice& device);

// Returns a scene in which a tick gives the recorded bits. `hash`: the hash of `volume`.
// Throws Error: kConflict if `volume` is not the recorded volume, or if the scene has settings that
// this program does not know.
// `tip`: of the scene before, empty at first; goes on to this scene's.
Scene ToScene(const RecordedScene& recorded, std::shared_ptr<const VolumeSnapshot> volume,
              const VolumeHash& hash, FeltTip& tip);

}  // namespace palpate
