// Reads the .vdb files of palpate-import and palpated with OpenVDB alone.
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

// Throws kInvalidArgument for a file that lacks something, and exceptions of OpenVDB.
VolumeFile ReadVolumeFile(const std::filesystem::path& path);

}  // namespace palpate
