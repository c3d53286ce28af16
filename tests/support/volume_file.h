// Reads the .vdb files that palpate-import and palpated write, by nothing but OpenVDB.
#pragma once

#include <filesystem>
#include <memory>

#include "server/volume/openvdb_names.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

struct VolumeFile {
  std::shared_ptr<openvdb::FloatGrid> grid;
  VolumeMetadata metadata;
};

// Throws Error (kInvalidArgument) for a file that lacks something, and what OpenVDB throws.
VolumeFile ReadVolumeFile(const std::filesystem::path& path);

}  // namespace palpate
