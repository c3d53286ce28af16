// Converts the messages of a volume from and to those of palpate.v1. Any thread.
#pragma once

#include "common/bricks/volume_event.h"
#include "palpate/v1/volume_stream.pb.h"

namespace palpate {

v1::VoxelType VoxelTypeOf(LeafType type);

// Moves the bricks instead of copying them.
v1::StreamVolumeResponse ToProto(VolumeMessage message);
// Errors: kInvalidArgument for a message without an event (from another version), or with sizes
// that do not fit an int.
VolumeMessage FromProto(v1::StreamVolumeResponse message);

v1::VolumeBricks ToProto(VolumeBricks bricks);
// Errors: kInvalidArgument for a type of voxels that this version does not know.
VolumeBricks FromProto(v1::VolumeBricks message);

}  // namespace palpate
