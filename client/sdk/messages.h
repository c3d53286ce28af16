// Poses, settings and edits: values of the client library <-> messages of palpate.v1. Any thread.
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

// Errors: kInvalidArgument for a block of negative numbers.
v1::EditVolumeRequest ToProto(const Edit& edit);
v1::FilterVolumeRequest ToProto(const Filter& filter);

}  // namespace palpate::client
