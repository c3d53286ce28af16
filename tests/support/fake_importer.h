// A program in the place of palpate-import, for tests without ITK: its input is
// what palpate-import would write. INPUT.N is frame N, if it is there.
#pragma once

#include <openvdb/openvdb.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>

#include "server/volume/snapshot_builder.h"
#include "server/volume/volume_file.h"

namespace palpate::testing {

inline std::filesystem::path WriteFakeImporter(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "importer.sh";
  std::ofstream(path) << R"(#!/bin/sh
frame=0
while [ $# -gt 2 ]; do
  case "$1" in --frame=*) frame=${1#--frame=} ;; esac
  shift
done
[ -e "$1.size" ] && cat "$1.size"
[ -e "$1.$frame.size" ] && cat "$1.$frame.size"
[ -e "$1.$frame" ] && exec cp "$1.$frame" "$2"
[ -e "$1" ] && exec cp "$1" "$2"
echo "palpate-import: $1: there is no such file" >&2
exit 4
)";
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

// Beside it "size X Y Z", which the importer says in advance.
inline void WriteFakeVolume(const std::filesystem::path& path, const Vec3i& size,
                            const std::function<float(int, int, int)>& value, int frames = 1) {
  openvdb::initialize();
  float least = value(0, 0, 0);
  for (int i = 0; i < size.x(); ++i) {
    for (int j = 0; j < size.y(); ++j) {
      for (int k = 0; k < size.z(); ++k) least = std::min(least, value(i, j, k));
    }
  }
  const auto grid = openvdb::FloatGrid::create(least);
  auto accessor = grid->getAccessor();
  for (int i = 0; i < size.x(); ++i) {
    for (int j = 0; j < size.y(); ++j) {
      for (int k = 0; k < size.z(); ++k) {
        if (value(i, j, k) != least) accessor.setValue(openvdb::Coord(i, j, k), value(i, j, k));
      }
    }
  }
  VolumeMetadata metadata;
  metadata.size = size;
  metadata.frames = frames;
  metadata.original_type = "float32";
  metadata.source = path.filename();
  SetValueRange(*grid, metadata);
  WriteVolumeFile(path, *grid, metadata);
  std::ofstream(path.string() + ".size")
      << "size " << size.x() << " " << size.y() << " " << size.z() << "\n";
}

}  // namespace palpate::testing
