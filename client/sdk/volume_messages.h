// Volumes and their place: values of the client library <-> messages of palpate.v1. Any thread.
#pragma once

#include "client/sdk/placement.h"
#include "client/sdk/volume.h"
#include "palpate/v1/registration.pb.h"
#include "palpate/v1/volume.pb.h"

namespace palpate::client {

VolumeInfo FromProto(const v1::VolumeDescription& volume);
// Without the source. Errors: kInvalidArgument for raw voxels of a negative size.
v1::LoadVolumeRequest ToProto(const LoadOptions& options);
// Of LoadVolumeResult and UploadVolumeResponse, which say the same.
template <class Message>
LoadResult LoadResultOf(const Message& message) {
  return {FromProto(message.volume()), message.applied_tick(), message.settings_revision()};
}

Placement FromProto(const v1::Registration& registration, std::uint64_t settings_revision);
v1::UpdateRegistrationRequest ToProto(const PlacementChange& change);

}  // namespace palpate::client
