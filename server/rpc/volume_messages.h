// Messages about volumes that several services share. Pure; any thread.
#pragma once

#include "palpate/v1/volume.pb.h"
#include "server/session/session.h"

namespace palpate {

v1::VolumeDescription ToProto(const VolumeState& state);

// Converts the request; the source is not judged yet. Throws Error (kInvalidArgument) for an
// unknown type of voxels. The loader checks everything else.
LoadRequest FromProto(const v1::LoadVolumeRequest& request);

}  // namespace palpate
