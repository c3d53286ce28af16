#include "server/import/voxel_writer.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "common/error/text.h"
#include "server/import/voxel_reader.h"
#include "server/volume/load/handover.h"
#include "server/volume/load/value_range.h"

namespace palpate {
namespace {

std::int64_t PlaceOf(std::int64_t voxel, LeafType type) {
  return kHandoverVoxels + voxel * static_cast<std::int64_t>(VoxelBytes(type));
}

bool IsFinite(float value) { return std::isfinite(value); }

}  // namespace

template <class T>
void VoxelWriter::Survey(const T* voxels, std::size_t count) {
  const auto [least, greatest] = RangeOf(voxels, count);
  least_ = std::min(least_, static_cast<float>(least));
  greatest_ = std::max(greatest_, static_cast<float>(greatest));
}

template <>
void VoxelWriter::Survey(const float* voxels, std::size_t count) {
  const float* const end = voxels + count;
  for (const float* voxel = voxels; voxel != end; ++voxel) {
    if (!IsFinite(*voxel)) {
      ++odd_;
      continue;
    }
    least_ = std::min(least_, *voxel);
    greatest_ = std::max(greatest_, *voxel);
  }
  for (const LeafType type : kLeafTypes) {
    bool& holds = holds_finite_[static_cast<std::size_t>(type)];
    holds = holds && std::all_of(voxels, end, [type](float value) {
              return Holds(type, value) || !IsFinite(value);
            });
  }
}

void VoxelWriter::Add(LeafType type, const void* voxels, std::size_t count) {
  VisitType(type, [&](auto voxel) { Survey(static_cast<const decltype(voxel)*>(voxels), count); });
  WriteHandoverAt(fd_, voxels, count * VoxelBytes(type), PlaceOf(count_, type));
  type_ = type;
  count_ += static_cast<std::int64_t>(count);
}

void VoxelWriter::Finish(VolumeMetadata metadata, const std::optional<Vec3>& spacing_mm,
                         Reporter* reporter) {
  reporter->Progress(0.8, "converting");
  const Vec3 own_spacing_mm = metadata.spacing_mm;
  if (spacing_mm) metadata.spacing_mm = *spacing_mm;
  FillOdd(reporter);
  metadata.value_min = least_;
  metadata.value_max = greatest_;
  CheckVolumeMetadata(metadata);
  metadata.is_level_set = IsLevelSet(LookForDistances(metadata.size, own_spacing_mm), reporter);
  WarnOfRounding(metadata, reporter);
  const LeafType type = HeldType(metadata);
  if (type != type_ || odd_ > 0) Rewrite(type);
  const HandoverHeader header = MakeHandoverHeader(metadata, type);
  WriteHandoverAt(fd_, &header, sizeof header, 0);
}

// Looks along some rows at voxels beside which the sign changes.
DistanceCheck::Verdict VoxelWriter::LookForDistances(const Vec3i& size,
                                                     const Vec3& spacing_mm) const {
  constexpr int kMostRows = 64;  // along y and z
  constexpr std::size_t kMostCrossings = 4000;
  DistanceCheck check;
  if (!(least_ < 0.0f && greatest_ > 0.0f)) return check.Judge(spacing_mm);
  const auto read = [&](const Vec3i& at, std::size_t count) {
    const std::int64_t voxel =
        at.x() + std::int64_t{size.x()} * (at.y() + std::int64_t{size.y()} * at.z());
    std::vector<char> bytes(count * VoxelBytes(type_));
    ReadHandoverAt(fd_, bytes.data(), bytes.size(), PlaceOf(voxel, type_));
    return FloatsOf(type_, bytes.data(), count);
  };
  const Vec3i step = ((size - Vec3i::Ones()) / kMostRows).cwiseMax(1);
  std::size_t crossings = 0;
  for (int z = 0; z < size.z(); z += step.z()) {
    for (int y = 0; y < size.y(); y += step.y()) {
      const std::vector<float> row = read({0, y, z}, static_cast<std::size_t>(size.x()));
      const bool is_border = y == 0 || z == 0;
      for (std::size_t x = 0; x < row.size(); x += is_border ? 1 : row.size() - 1) {
        check.AddOutside(row[x]);
      }
      if (is_border || y + 1 == size.y() || z + 1 == size.z()) continue;
      for (int x = 1; x + 1 < size.x() && crossings < kMostCrossings; ++x) {
        const auto n = static_cast<std::size_t>(x);
        if ((row[n] < 0.0f) == (row[n + 1] < 0.0f)) continue;
        ++crossings;
        check.AddGradient(0.5 * Vec3(row[n + 1] - row[n - 1],
                                     read({x, y + 1, z}, 1)[0] - read({x, y - 1, z}, 1)[0],
                                     read({x, y, z + 1}, 1)[0] - read({x, y, z - 1}, 1)[0]));
      }
    }
  }
  return check.Judge(spacing_mm);
}

LeafType VoxelWriter::HeldType(const VolumeMetadata& metadata) const {
  if (type_ != LeafType::kFloat) return type_;
  const auto holds = [this](LeafType type) {
    return holds_finite_[static_cast<std::size_t>(type)];
  };
  // Scaled voxels may not fit the file's own type.
  const std::optional<LeafType> own = LeafTypeNamed(metadata.original_type);
  if (own && holds(*own)) return *own;
  return *std::find_if(std::begin(kLeafTypes), std::end(kLeafTypes), holds);
}

void VoxelWriter::FillOdd(Reporter* reporter) {
  if (odd_ == count_) {
    throw Error(ErrorKind::kInvalidArgument,
                "no voxel is a finite number of float range; there is nothing to feel");
  }
  if (padding_ <= least_) {
    Survey(&padding_, 1);
  } else if (odd_ > 0) {
    const bool is_padding = std::isfinite(padding_);
    reporter->Warn(std::to_string(odd_) +
                   (is_padding ? " voxels are padding (PixelPaddingValue)"
                               : " voxels are not finite numbers of float range") +
                   "; they got the least value" + (is_padding ? " of the others, " : ", ") +
                   NumberText(least_) + (is_padding ? kReadOtherwise : ""));
  }
}

// Voxels that no smaller type holds are held as 32 bit floats.
void VoxelWriter::WarnOfRounding(const VolumeMetadata& metadata, Reporter* reporter) const {
  constexpr double kFirstRounded = 1 << 24;  // also what 2^24 + 1 becomes
  const bool is_integer = metadata.original_type == "int32" || metadata.original_type == "uint32";
  if (is_integer && std::max(-metadata.value_min, metadata.value_max) >= kFirstRounded) {
    reporter->Warn("integers of 2^24 and more are rounded to 32 bit floats, and so they are saved");
  } else if (metadata.original_type == "float64" && HeldType(metadata) == LeafType::kFloat) {
    reporter->Warn("64 bit floats are rounded to 32 bit floats, and so they are saved");
  }
}

// Turns the floats in the hand-over into voxels of this type. These are no larger, so no float is
// overwritten before it is read.
void VoxelWriter::Rewrite(LeafType type) const {
  constexpr std::int64_t kChunk = 1 << 18;
  std::vector<float> floats(kChunk);
  VisitType(type, [&](auto voxel) {
    using T = decltype(voxel);
    std::vector<T> voxels(kChunk);
    for (std::int64_t n = 0; n < count_; n += kChunk) {
      const auto count = static_cast<std::size_t>(std::min(kChunk, count_ - n));
      ReadHandoverAt(fd_, floats.data(), count * sizeof(float), PlaceOf(n, LeafType::kFloat));
      std::transform(floats.data(), floats.data() + count, voxels.begin(), [this](float value) {
        return static_cast<T>(IsFinite(value) ? value : least_);
      });
      WriteHandoverAt(fd_, voxels.data(), count * sizeof(T), PlaceOf(n, type));
    }
  });
  if (ftruncate(fd_, PlaceOf(count_, type)) != 0) FailHandover("cannot shorten the hand-over");
}

}  // namespace palpate
