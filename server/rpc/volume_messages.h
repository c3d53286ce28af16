// Messages about volumes that several services share. Pure; any thread.
#pragma once

#include "palpate/v1/volume.pb.h"
#include "server/session/session.h"

namespace palpate {

v1::VolumeDescription ToProto(const VolumeState& state);

// As given, the source not yet judged. Throws Error (kInvalidArgument) for a type
// of voxels that is unknown; all else is the loader's.
LoadRequest FromProto(const v1::LoadVolumeRequest& request);

}  // namespace palpate
