// A program that replaces palpate-import, for tests without its libraries. Its input file has the
// bytes that palpate-import would hand over. INPUT.N, if it exists, is frame N.
#pragma once

#include <fcntl.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "tests/support/written_handover.h"

namespace palpate::testing {

inline std::filesystem::path WriteFakeImporter(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "importer.sh";
  std::ofstream(path) << R"(#!/bin/sh
frame=0
while [ $# -gt 1 ]; do
  case "$1" in --frame=*) frame=${1#--frame=} ;; esac
  shift
done
[ -e "$1.size" ] && cat "$1.size"
[ -e "$1.$frame.size" ] && cat "$1.$frame.size"
[ -e "$1.$frame" ] && exec cat "$1.$frame" >&3
[ -e "$1" ] && exec cat "$1" >&3
echo "palpate-import: $1: there is no such file" >&2
exit 4
)";
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

// Also writes a file with "size X Y Z BYTES", which the importer reports in advance.
inline void WriteFakeVolume(const std::filesystem::path& path, const Vec3i& size,
                            const std::function<float(int, int, int)>& value, int frames = 1) {
  std::vector<float> voxels;
  for (int k = 0; k < size.z(); ++k) {
    for (int j = 0; j < size.y(); ++j) {
      for (int i = 0; i < size.x(); ++i) voxels.push_back(value(i, j, k));
    }
  }
  const auto [least, greatest] = std::minmax_element(voxels.begin(), voxels.end());
  VolumeMetadata metadata;
  metadata.size = size;
  metadata.frames = frames;
  metadata.value_min = *least;
  metadata.value_max = *greatest;
  metadata.original_type = "float32";
  metadata.source = path.filename();
  const Descriptor file(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
  WriteHandover(file.get(), metadata, LeafType::kFloat, voxels);
  std::ofstream(path.string() + ".size")
      << "size " << size.x() << " " << size.y() << " " << size.z() << " 4\n";
}

}  // namespace palpate::testing
