// Settings of the client library <-> messages of palpate.v1. Any thread.
#pragma once

#include <cstdint>

#include "client/sdk/settings.h"
#include "palpate/v1/render.pb.h"

namespace palpate::client {

// What the message does not have, and choices of a later version, are Settings::unknown.
Settings FromProto(const v1::RenderSettings& settings, std::uint64_t revision);

v1::UpdateSettingsRequest ToProto(const SettingsUpdate& update);

}  // namespace palpate::client
