// Converts VolumeMessage from and to v1::StreamVolumeResponse. Any thread.
#pragma once

#include "common/bricks/volume_event.h"
#include "palpate/v1/volume_stream.pb.h"

namespace palpate {

// Moves the bricks instead of copying them.
v1::StreamVolumeResponse ToProto(VolumeMessage message);
// Errors: kInvalidArgument for a message without an event (from another version), or with sizes
// that do not fit an int.
VolumeMessage FromProto(v1::StreamVolumeResponse message);

}  // namespace palpate
