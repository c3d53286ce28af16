// What a recording holds, as messages (palpate/v1/recorded.proto) and as values.
//
// Threads: pure. Not for real-time code. Errors: DamagedBytes or Error(kInvalidArgument) for a
// message that no recorder writes.
#pragma once

#include <functional>
#include <string>

#include "common/contract/recorded.h"
#include "palpate/v1/recorded.pb.h"
#include "palpate/v1/render.pb.h"
#include "server/felt/scene.h"
#include "server/pump/tick_sample.h"
#include "server/recording/recording.h"

namespace palpate {

// Sets all fields.
v1::RenderSettings ToProto(const RenderSettings& settings);

v1::RecordedScene ToProto(const RecordedScene& scene);
RecordedScene FromProto(const v1::RecordedScene& scene);

// Calls `take` for each part of at most 300 KB. Numbers must be ascending.
void ForEachPart(const RecordedEdit& edit,
                 const std::function<void(const v1::RecordedVoxels&)>& take);
RecordedEdit FromProto(v1::RecordedVoxels&& part);

// The schema of a message for MCAP: a FileDescriptorSet with what it needs, and no more.
std::string SchemaOf(const google::protobuf::Descriptor& message);

// A tick as the servo has it, and as recordings have it.
//
// Frames and units: as in TickSample. Threads: pure. Neither allocates.

// Why a recording with other hands than 0 is refused.
inline constexpr const char* kSeveralHands =
    "of several hands, which this program cannot replay: a newer one wrote it";

RecordedTick RecordedTickOf(const TickSample& sample);
// Throws DamagedBytes for an enumerator that this version does not know.
TickSample SampleOf(const RecordedTick& tick);

}  // namespace palpate
