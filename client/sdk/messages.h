// Values of the client library <-> messages of palpate.v1. Any thread.
#pragma once

#include "client/sdk/daemon_info.h"
#include "client/sdk/edit.h"
#include "client/sdk/pose.h"
#include "client/sdk/setting_messages.h"
#include "palpate/v1/device.pb.h"
#include "palpate/v1/edit.pb.h"
#include "palpate/v1/pose.pb.h"
#include "palpate/v1/recording.pb.h"
#include "palpate/v1/render.pb.h"
#include "palpate/v1/series.pb.h"

namespace palpate::client {

// Enumerators of a later version become kUnknown, or the default.
Pose FromProto(const v1::PoseSample& sample);
ForceStatus FromProto(const v1::ForceStatus& forces);
EditResult FromProto(const v1::EditVolumeResponse& response);
DeviceInfo FromProto(const v1::GetDeviceResponse& response);
SeriesState FromProto(const v1::SeriesState& state);
RecordingState FromProto(const v1::RecordingState& state);

// Errors: kInvalidArgument for a block of negative numbers.
v1::EditVolumeRequest ToProto(const Edit& edit);
v1::FilterVolumeRequest ToProto(const Filter& filter);
v1::ControlSeriesRequest ToProto(const SeriesControl& control);

}  // namespace palpate::client
