// Changes of the volume's voxels; edit.proto explains them. A voxel's weight is 1 within the shape
// and falls smoothly to 0 over `falloff` outside of the shape.
//
// Frames: W world (mm, LPS as in DICOM) or I voxel indices, as the edit says. Values are in data
// units.
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "common/contract/edit.h"
#include "common/contract/enumerations.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

using palpate::EditFrame;
using palpate::EditOperation;
using palpate::FilterKind;
using palpate::IndexBox;

using EditResult = EditVolumeResponse;

using Sphere = SphereShape;
using Box = BoxShape;
using Capsule = CapsuleShape;
// Voxels min .. min + size - 1, all within the volume. Always in frame I and without falloff.
struct Block {
  Vec3i min = Vec3i::Zero();
  Vec3i size = Vec3i::Zero();
  std::vector<float> values{};  // x fastest; at most 3 MiB
};

struct Edit {
  std::variant<Sphere, Box, Capsule, Block> shape{};
  EditFrame frame = EditFrame::kWorld;
  EditOperation operation = EditOperation::kAdd;
  double value = 0.0;     // ignored for a block, which has its own values
  double strength = 1.0;  // in (0, 1], for smooth and paint
  double falloff = 0.0;   // in the frame's unit
  // Fails with ErrorKind::kConflict unless the volume is at this revision.
  std::optional<std::uint64_t> expected_revision{};
  // Successive edits with the same number, chosen at random, are one step and act once on each
  // voxel; 0: the edit stands alone.
  std::uint64_t stroke = 0;
};

// A filter of OpenVDB; edit.proto explains it.
struct Filter {
  FilterKind kind = FilterKind::kGaussian;
  int width = 1;  // voxels; for the first three kinds
  int iterations = 1;
  double distance_mm = 0.0;        // for an offset: outwards
  Vec3 spacing_mm = Vec3::Zero();  // for resampling
  // The voxels to replace, without falloff; none: all.
  std::variant<std::monostate, Sphere, Box> region{};
  EditFrame frame = EditFrame::kWorld;  // the frame of `region`
  // Fails with ErrorKind::kConflict unless the filter starts with the volume at this revision.
  std::optional<std::uint64_t> expected_revision{};
};

}  // namespace palpate::client
