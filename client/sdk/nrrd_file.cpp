#include "client/sdk/nrrd_file.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "common/files/nrrd_header.h"

namespace palpate::client {
namespace {

constexpr double kGib = 1 << 30;
constexpr double kMostBytes = 16 * kGib;

// Fills the rows from `place` on along x, of one slice and one row of bricks. T must hold every
// voxel.
template <class T>
void FillRows(const BrickMap& bricks, const Vec3i& size, Vec3i place, std::vector<T>& rows) {
  const int row_count = std::min(kBrickEdge, size.y() - place.y());
  rows.resize(static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(row_count));
  for (place.x() = 0; place.x() < size.x(); place.x() += kBrickEdge) {
    const TypedBrick& brick = *bricks.At(place / kBrickEdge);
    const int width = std::min(kBrickEdge, size.x() - place.x());
    VisitType(brick.type(), [&](auto voxel) {
      const auto* const values = brick.values<decltype(voxel)>();
      for (int j = 0; j < row_count; ++j) {
        T* const row = rows.data() + static_cast<std::ptrdiff_t>(j) * size.x() + place.x();
        if (brick.is_constant()) {
          std::fill_n(row, width, static_cast<T>(values[0]));
          continue;
        }
        for (int i = 0; i < width; ++i) {
          row[i] = static_cast<T>(values[VoxelInBrick(i, j, place.z())]);
        }
      }
    });
  }
}

template <class T>
void WriteVoxels(const BrickMap& bricks, const Vec3i& size, NewFile& file,
                 const std::function<void()>& check) {
  std::vector<T> rows;
  for (int k = 0; k < size.z(); ++k) {
    if (check) check();
    for (int j = 0; j < size.y(); j += kBrickEdge) {
      FillRows(bricks, size, {0, j, k}, rows);
      file.Write({reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(T)});
    }
  }
}

}  // namespace

void CheckNrrdSize(const Vec3i& size, LeafType type) {
  // In floating point: the product of three sizes can overflow any integer.
  const double bytes = size.cast<double>().prod() * static_cast<double>(VoxelBytes(type));
  if (bytes <= kMostBytes) return;
  const auto gib = static_cast<std::int64_t>(bytes / kGib);
  throw Error(ErrorKind::kTooLarge,
              "an NRRD file of " + std::to_string(size.x()) + " x " + std::to_string(size.y()) +
                  " x " + std::to_string(size.z()) + " voxels takes " + std::to_string(gib) +
                  " GiB or more, over the limit of 16 GiB: name a .vdb file, which leaves out the "
                  "background");
}

void CheckNrrdPath(const std::string& path, bool overwrite) {
  CheckNewFile(path, ReplacesIf(overwrite));
}

void SaveAsNrrd(const VolumeMirror& volume, const std::string& path, bool overwrite,
                const std::function<void()>& check) {
  const auto& placement = volume.placement();
  const bool is_lps =
      placement && placement->patient_axes == "LPS" && !placement->patient_axes_answered;
  SaveAsNrrd(volume.bricks(), *volume.lattice(), is_lps, path, overwrite, check);
}

void SaveAsNrrd(const BrickMap& bricks, const VolumeLattice& lattice, bool is_lps,
                const std::string& path, bool overwrite, const std::function<void()>& check) {
  // Of the smallest type first, so that only bricks of a file are looked at.
  CheckNrrdSize(lattice.size, LeafType::kUint8);
  const LeafType type = bricks.SmallestType();
  CheckNrrdSize(lattice.size, type);
  NewFile file(path, ReplacesIf(overwrite));
  file.Write(ToText(NrrdHeader{.type = type == LeafType::kFloat ? "float" : std::string(Name(type)),
                               .encoding = "raw",
                               .size = lattice.size,
                               .X_WI = lattice.X_WI,
                               .is_lps = is_lps,
                               .unit = lattice.unit}));
  VisitType(type,
            [&](auto voxel) { WriteVoxels<decltype(voxel)>(bricks, lattice.size, file, check); });
  file.TakeName();
}

}  // namespace palpate::client
