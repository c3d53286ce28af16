// Writes voxels in a row to the hand-over while a reader delivers them, and the last steps that all
// formats share. The voxels lie in the hand-over only, so the importer needs no memory of its own
// for them.
//
// Threads: one. Not for real-time code. Errors: palpate::Error without the file's name.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>

#include "common/bricks/leaf_type.h"
#include "server/import/reporter.h"
#include "server/import/value_checks.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

class VoxelWriter {
 public:
  explicit VoxelWriter(int fd) : fd_(fd) {}

  // A VoxelSink (voxel_reader.h). Voxels of another type than float must be of the file's own type.
  void Add(LeafType type, const void* voxels, std::size_t count);

  // Voxels that are not finite get this value, if it is below all others.
  void SetPadding(float value) { padding_ = value; }

  // Call it after all voxels. `metadata`: complete except for the value range. Replaces voxels that
  // are not finite by the least finite value, or by the padding. Holds the voxels in the file's own
  // type, or in the smallest type that holds each voxel exactly. Warns of replaced voxels, and
  // where 32 bit floats do not hold what the file has. Throws kInvalidArgument for a constant
  // volume or an unsupported geometry.
  void Finish(VolumeMetadata metadata, const std::optional<Vec3>& spacing_mm, Reporter* reporter);

 private:
  template <class T>
  void Survey(const T* voxels, std::size_t count);
  DistanceCheck::Verdict LookForDistances(const Vec3i& size, const Vec3& spacing_mm) const;
  LeafType HeldType(const VolumeMetadata& metadata) const;
  void FillOdd(Reporter* reporter);
  void WarnOfRounding(const VolumeMetadata& metadata, Reporter* reporter) const;
  void Rewrite(LeafType type) const;

  const int fd_;
  LeafType type_ = LeafType::kFloat;
  std::int64_t count_ = 0;
  // Facts about all voxels so far.
  float least_ = std::numeric_limits<float>::infinity();
  float greatest_ = -std::numeric_limits<float>::infinity();
  float padding_ = std::numeric_limits<float>::infinity();
  std::int64_t odd_ = 0;                                      // not finite
  std::array<bool, 4> holds_finite_{true, true, true, true};  // of each of kLeafTypes, for floats
};

}  // namespace palpate
