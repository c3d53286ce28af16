// VolumeMessage <-> v1::StreamVolumeResponse. Any thread.
#pragma once

#include "common/bricks/volume_event.h"
#include "palpate/v1/volume_stream.pb.h"

namespace palpate {

// Voxels are moved, not copied.
v1::StreamVolumeResponse ToProto(VolumeMessage message);
// Errors: kInvalidArgument for a message without an event, of another version
// then, and for one whose sizes do not fit an int.
VolumeMessage FromProto(v1::StreamVolumeResponse message);

v1::VolumeRevision ToProto(const VolumeRevision& revision);
VolumeRevision FromProto(const v1::VolumeRevision& revision);

}  // namespace palpate
