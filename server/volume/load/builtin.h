// Computes built-in volumes: "builtin:cylinder", "builtin:sphere[:N]", "builtin:bumps[:N]",
// "builtin:gyroid[:N]".
//
// Cylinder: 100×100×30; density 1 on the axis (along z), falling linearly to 0 at radius 50 voxels.
// The others: N³ voxels (default 128), density clamp(½ − s/8, 0, 1), where s is a field in voxels
// similar to a signed distance. So the surface s = 0 has density ½ and a slope of 1/8 per voxel.
//
// Threads: non-real-time, any.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string_view>

#include "server/volume/snapshot/openvdb_names.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

struct BuiltinVolume {
  std::shared_ptr<openvdb::FloatGrid> grid;
  VolumeMetadata metadata;
};

bool IsBuiltin(std::string_view source);

// The size in voxels. Throws Error (kInvalidArgument) for an unknown name or a bad N.
Vec3i BuiltinSize(std::string_view source);

// `cancelled`: asked from time to time; may be empty. Throws Error: kInvalidArgument for an unknown
// name, a bad N or spacing; kTooLarge above max_voxels; kCancelled.
BuiltinVolume MakeBuiltin(std::string_view source, const Vec3& spacing_mm = Vec3::Ones(),
                          std::int64_t max_voxels = std::int64_t{1} << 31,
                          const std::function<bool()>& cancelled = {});

}  // namespace palpate
