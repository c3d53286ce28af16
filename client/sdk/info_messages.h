// Converts device, activity, series and recordings between the client library and messages of
// palpate.v1. Enumerators of a later version become kUnknown. Threads: any.
#pragma once

#include "client/sdk/activity.h"
#include "client/sdk/device.h"
#include "client/sdk/recording.h"
#include "client/sdk/series.h"
#include "palpate/v1/activity.pb.h"
#include "palpate/v1/device.pb.h"
#include "palpate/v1/recording.pb.h"
#include "palpate/v1/series.pb.h"

namespace palpate::client {

ForceStatus FromProto(const v1::ForceStatus& forces);
DeviceHealth FromProto(const v1::DeviceHealth& health);
DaemonInfo FromProto(const v1::GetDeviceResponse& response);
ListedDevice FromProto(const v1::ListedDevice& device);
Activity FromProto(const v1::GetActivityResponse& response);
SeriesState FromProto(const v1::SeriesState& state, std::optional<std::uint64_t> applied_tick = {});
RecordingState FromProto(const v1::RecordingState& state);
v1::ControlSeriesRequest ToProto(const SeriesControl& control);

}  // namespace palpate::client
