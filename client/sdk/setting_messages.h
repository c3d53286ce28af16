// Converts settings between the client library and messages of palpate.v1. Threads: any.
#pragma once

#include <cstdint>

#include "client/sdk/settings.h"
#include "common/wire/convert.h"
#include "common/wire/values.h"
#include "palpate/v1/render.pb.h"

namespace palpate::client {

// Those of common stand beside the library's own.
using palpate::FromProto;
using palpate::ToProto;

// Settings::unknown lists what the message does not have, and choices of a later version.
Settings FromProto(const v1::RenderSettings& settings, std::uint64_t revision,
                   const v1::BallState& ball = {}, bool replayed = false);

v1::UpdateSettingsRequest ToProto(const SettingsUpdate& update);

}  // namespace palpate::client
