// What the library's own arguments are in messages of palpate.v1. Values of common/contract are
// converted by common/wire/values.h.
//
// Threads: any.
#pragma once

#include <cstdint>

#include "client/sdk/edit.h"
#include "client/sdk/settings.h"
#include "client/sdk/volume.h"
#include "common/wire/convert.h"
#include "common/wire/values.h"
#include "palpate/v1/edit.pb.h"
#include "palpate/v1/render.pb.h"
#include "palpate/v1/volume.pb.h"

namespace palpate::client {

// Those of common stand beside the library's own.
using palpate::FromProto;
using palpate::ToProto;

// Settings::unknown lists what the message does not have, and choices of a later version.
Settings FromProto(const v1::RenderSettings& settings, std::uint64_t revision,
                   const v1::BallState& ball = {}, bool replayed = false);

v1::UpdateSettingsRequest ToProto(const SettingsUpdate& update);

// Errors: kInvalidArgument for a block with negative numbers, kTooLarge for a block of more than 3
// MiB.
v1::EditVolumeRequest ToProto(const Edit& edit);
v1::FilterVolumeRequest ToProto(const Filter& filter);
// Leaves the source empty. Errors: kInvalidArgument for raw voxels of a negative size, for two
// isovalues, and for settings that expect a revision.
v1::LoadVolumeRequest ToProto(const LoadOptions& options);

}  // namespace palpate::client
