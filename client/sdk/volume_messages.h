// Converts volumes and their place between the client library and messages of palpate.v1. Threads:
// any.
#pragma once

#include "client/sdk/placement.h"
#include "client/sdk/volume.h"
#include "palpate/v1/registration.pb.h"
#include "palpate/v1/volume.pb.h"

namespace palpate::client {

VolumeInfo FromProto(const v1::VolumeDescription& volume);
// Leaves the source empty. Errors: kInvalidArgument for raw voxels of a negative size.
v1::LoadVolumeRequest ToProto(const LoadOptions& options);
// Works for LoadVolumeResult and UploadVolumeResponse; both have the same fields.
template <class Message>
LoadResult LoadResultOf(const Message& message) {
  return {FromProto(message.volume()), message.applied_tick(), message.settings_revision(),
          message.isovalue()};
}

Placement FromProto(const v1::Registration& registration, std::uint64_t settings_revision);
v1::UpdateRegistrationRequest ToProto(const PlacementChange& change);

}  // namespace palpate::client
