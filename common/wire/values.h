// Written by proto/generate from palpate/v1/*.proto: change those.
//
// Fields that are missing get their defaults; enumerators of a later version are kUnknown. Threads:
// any. Errors: kInvalidArgument for a negative number of voxels, one that does not fit an int, and a
// map without nine numbers.
#pragma once

#include "common/contract/device.h"
#include "common/contract/activity.h"
#include "common/contract/edit.h"
#include "common/contract/recording.h"
#include "common/contract/render.h"
#include "common/contract/volume_stream.h"
#include "common/contract/volume.h"
#include "common/contract/series.h"
#include "common/contract/pose.h"
#include "common/contract/recorded.h"
#include "common/contract/registration.h"
#include "palpate/v1/device.pb.h"
#include "palpate/v1/activity.pb.h"
#include "palpate/v1/edit.pb.h"
#include "palpate/v1/recording.pb.h"
#include "palpate/v1/render.pb.h"
#include "palpate/v1/volume_stream.pb.h"
#include "palpate/v1/volume.pb.h"
#include "palpate/v1/series.pb.h"
#include "palpate/v1/pose.pb.h"
#include "palpate/v1/recorded.pb.h"
#include "palpate/v1/registration.pb.h"

namespace palpate {

ForceStatus FromProto(const v1::ForceStatus& message);
v1::ForceStatus ToProto(const ForceStatus& value);
ListedDevice FromProto(const v1::ListedDevice& message);
v1::ListedDevice ToProto(const ListedDevice& value);
DeviceHealth FromProto(const v1::DeviceHealth& message);
v1::DeviceHealth ToProto(const DeviceHealth& value);
CallerDescription FromProto(const v1::CallerDescription& message);
v1::CallerDescription ToProto(const CallerDescription& value);
DeviceDescription FromProto(const v1::DeviceDescription& message);
v1::DeviceDescription ToProto(const DeviceDescription& value);
ServoDescription FromProto(const v1::ServoDescription& message);
v1::ServoDescription ToProto(const ServoDescription& value);
EnableForcesResponse FromProto(const v1::EnableForcesResponse& message);
v1::EnableForcesResponse ToProto(const EnableForcesResponse& value);
GetDeviceResponse FromProto(const v1::GetDeviceResponse& message);
v1::GetDeviceResponse ToProto(const GetDeviceResponse& value);
Hand FromProto(const v1::Hand& message);
v1::Hand ToProto(const Hand& value);
HandsState FromProto(const v1::HandsState& message);
v1::HandsState ToProto(const HandsState& value);
ConnectedCaller FromProto(const v1::ConnectedCaller& message);
v1::ConnectedCaller ToProto(const ConnectedCaller& value);
LastChange FromProto(const v1::LastChange& message);
v1::LastChange ToProto(const LastChange& value);
GetActivityResponse FromProto(const v1::GetActivityResponse& message);
v1::GetActivityResponse ToProto(const GetActivityResponse& value);
SphereShape FromProto(const v1::SphereShape& message);
v1::SphereShape ToProto(const SphereShape& value);
BoxShape FromProto(const v1::BoxShape& message);
v1::BoxShape ToProto(const BoxShape& value);
CapsuleShape FromProto(const v1::CapsuleShape& message);
v1::CapsuleShape ToProto(const CapsuleShape& value);
IndexBox FromProto(const v1::IndexBox& message);
v1::IndexBox ToProto(const IndexBox& value);
EditVolumeResponse FromProto(const v1::EditVolumeResponse& message);
v1::EditVolumeResponse ToProto(const EditVolumeResponse& value);
RunningReplay FromProto(const v1::RunningReplay& message);
v1::RunningReplay ToProto(const RunningReplay& value);
RecordedMarker FromProto(const v1::RecordedMarker& message);
v1::RecordedMarker ToProto(const RecordedMarker& value);
RecordedFile FromProto(const v1::RecordedFile& message);
v1::RecordedFile ToProto(const RecordedFile& value);
RecordingState FromProto(const v1::RecordingState& message);
v1::RecordingState ToProto(const RecordingState& value);
ReplayResponse FromProto(const v1::ReplayResponse& message);
v1::ReplayResponse ToProto(const ReplayResponse& value);
ListRecordingsResponse FromProto(const v1::ListRecordingsResponse& message);
v1::ListRecordingsResponse ToProto(const ListRecordingsResponse& value);
SurfaceLayer FromProto(const v1::SurfaceLayer& message);
v1::SurfaceLayer ToProto(const SurfaceLayer& value);
HeldToolBall FromProto(const v1::HeldToolBall& message);
v1::HeldToolBall ToProto(const HeldToolBall& value);
BallState FromProto(const v1::BallState& message);
v1::BallState ToProto(const BallState& value);
SurfaceLayers FromProto(const v1::SurfaceLayers& message);
v1::SurfaceLayers ToProto(const SurfaceLayers& value);
HeldTool FromProto(const v1::HeldTool& message);
v1::HeldTool ToProto(const HeldTool& value);
VolumeRevision FromProto(const v1::VolumeRevision& message);
v1::VolumeRevision ToProto(const VolumeRevision& value);
VolumeOverview FromProto(const v1::VolumeOverview& message);
v1::VolumeOverview ToProto(const VolumeOverview& value);
VolumePlacement FromProto(const v1::VolumePlacement& message);
v1::VolumePlacement ToProto(const VolumePlacement& value);
SuggestedIsovalue FromProto(const v1::SuggestedIsovalue& message);
v1::SuggestedIsovalue ToProto(const SuggestedIsovalue& value);
ValueHistogram FromProto(const v1::ValueHistogram& message);
v1::ValueHistogram ToProto(const ValueHistogram& value);
SaveVolumeResult FromProto(const v1::SaveVolumeResult& message);
v1::SaveVolumeResult ToProto(const SaveVolumeResult& value);
VolumeDescription FromProto(const v1::VolumeDescription& message);
v1::VolumeDescription ToProto(const VolumeDescription& value);
LoadVolumeResult FromProto(const v1::LoadVolumeResult& message);
v1::LoadVolumeResult ToProto(const LoadVolumeResult& value);
SeriesState FromProto(const v1::SeriesState& message);
v1::SeriesState ToProto(const SeriesState& value);
ControlSeriesRequest FromProto(const v1::ControlSeriesRequest& message);
v1::ControlSeriesRequest ToProto(const ControlSeriesRequest& value);
LoadSeriesResult FromProto(const v1::LoadSeriesResult& message);
v1::LoadSeriesResult ToProto(const LoadSeriesResult& value);
ControlSeriesResponse FromProto(const v1::ControlSeriesResponse& message);
v1::ControlSeriesResponse ToProto(const ControlSeriesResponse& value);
PoseSample FromProto(const v1::PoseSample& message);
v1::PoseSample ToProto(const PoseSample& value);
RecordedTick FromProto(const v1::RecordedTick& message);
v1::RecordedTick ToProto(const RecordedTick& value);
RecordedKeyframe FromProto(const v1::RecordedKeyframe& message);
v1::RecordedKeyframe ToProto(const RecordedKeyframe& value);
RecordedEvent FromProto(const v1::RecordedEvent& message);
v1::RecordedEvent ToProto(const RecordedEvent& value);
RecordedClock FromProto(const v1::RecordedClock& message);
v1::RecordedClock ToProto(const RecordedClock& value);
Registration FromProto(const v1::Registration& message);
v1::Registration ToProto(const Registration& value);
PatientFacing FromProto(const v1::PatientFacing& message);
v1::PatientFacing ToProto(const PatientFacing& value);
GetRegistrationResponse FromProto(const v1::GetRegistrationResponse& message);
v1::GetRegistrationResponse ToProto(const GetRegistrationResponse& value);
UpdateRegistrationRequest FromProto(const v1::UpdateRegistrationRequest& message);
v1::UpdateRegistrationRequest ToProto(const UpdateRegistrationRequest& value);
UpdateRegistrationResponse FromProto(const v1::UpdateRegistrationResponse& message);
v1::UpdateRegistrationResponse ToProto(const UpdateRegistrationResponse& value);

}  // namespace palpate
