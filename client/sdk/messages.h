// Converts poses, settings and edits between the client library and messages of palpate.v1.
// Threads: any.
#pragma once

#include "client/sdk/edit.h"
#include "client/sdk/pose.h"
#include "client/sdk/setting_messages.h"
#include "palpate/v1/edit.pb.h"
#include "palpate/v1/pose.pb.h"
#include "palpate/v1/render.pb.h"

namespace palpate::client {

// Enumerators of a later version become kUnknown, or the default.
Pose FromProto(const v1::PoseSample& sample);
EditResult FromProto(const v1::EditVolumeResponse& response);

// Errors: kInvalidArgument for a block with negative numbers, kTooLarge for a block of more than 3
// MiB.
v1::EditVolumeRequest ToProto(const Edit& edit);
v1::FilterVolumeRequest ToProto(const Filter& filter);

}  // namespace palpate::client
