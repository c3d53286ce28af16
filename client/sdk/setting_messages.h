// Converts settings between the client library and messages of palpate.v1. Threads: any.
#pragma once

#include <cstdint>

#include "client/sdk/settings.h"
#include "palpate/v1/render.pb.h"

namespace palpate::client {

// Settings::unknown lists what the message does not have, and choices of a later version.
Settings FromProto(const v1::RenderSettings& settings, std::uint64_t revision);

v1::UpdateSettingsRequest ToProto(const SettingsUpdate& update);

}  // namespace palpate::client
