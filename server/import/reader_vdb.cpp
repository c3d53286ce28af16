#include <fstream>
#include <string>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>

#include "server/import/readers.h"
#include "server/volume/volume_metadata.h"

namespace palpate {
namespace {

openvdb::GridBase::Ptr ReadOnlyGrid(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  // Else a truncated file would be read as if zeros followed.
  in.exceptions(std::ios::badbit | std::ios::failbit);
  openvdb::io::Stream stream(in, /*delayLoad=*/false);
  const openvdb::GridPtrVecPtr grids = stream.getGrids();
  if (grids->size() != 1 || !(*grids)[0]) {
    Refuse("there are " + std::to_string(grids->size()) + " grids; save the one wanted alone");
  }
  return (*grids)[0];
}

// OpenVDB multiplies row vectors from the left.
void CopyGeometry(const openvdb::math::Transform& transform, const openvdb::Coord& first,
                  VolumeMetadata* metadata) {
  if (!transform.isLinear()) Refuse("the grid's transform is not linear; resample it first");
  const openvdb::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();
  for (int col = 0; col < 3; ++col) {
    Vec3 step;
    for (int row = 0; row < 3; ++row) step[row] = matrix(col, row);
    metadata->spacing_mm[col] = step.norm();
    CheckSpacing(metadata->spacing_mm[col]);
    metadata->direction.col(col) = step / step.norm();
  }
  const openvdb::Vec3d origin = transform.indexToWorld(first);
  metadata->origin_W_mm = {origin.x(), origin.y(), origin.z()};
}

// The box of the volume, [0, size) for files of our own: these leave the
// voxels of the least value inactive.
template <typename Grid>
openvdb::CoordBBox VolumeBox(const Grid& grid, VolumeMetadata* metadata) {
  const openvdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
  const auto size = grid.template getMetadata<openvdb::Vec3IMetadata>("palpate_size");
  if (size) {
    const openvdb::Vec3i s = size->value();
    const openvdb::CoordBBox box({0, 0, 0}, openvdb::Coord(s.x(), s.y(), s.z()).offsetBy(-1));
    for (const auto& [name, text] :
         {std::pair("palpate_unit", &metadata->unit),
          std::pair("palpate_original_type", &metadata->original_type)}) {
      const auto entry = grid.template getMetadata<openvdb::StringMetadata>(name);
      if (entry) *text = entry->value();
    }
    const auto frames = grid.template getMetadata<openvdb::Int32Metadata>("palpate_frames");
    if (frames) metadata->frames = frames->value();
    if (box.isInside(active)) return box;
  }
  if (active.empty()) Refuse("the grid has no active voxels; there is nothing to feel");
  return active;
}

template <typename Grid>
DenseVolume FromGrid(const Grid& grid, const char* type, const ImportLimits& limits) {
  DenseVolume volume;
  volume.metadata.original_type = type;
  const openvdb::CoordBBox box = VolumeBox(grid, &volume.metadata);
  // Not dim(): a box may be wider than its 32 bits.
  std::vector<std::int64_t> axes;
  for (int k = 0; k < 3; ++k) {
    axes.push_back(std::int64_t{box.max()[k]} - std::int64_t{box.min()[k]} + 1);
  }
  const auto size = VolumeSize(axes);
  CheckedVoxelBytes(size, sizeof(float), limits);
  for (int k = 0; k < 3; ++k) volume.metadata.size[k] = static_cast<int>(size[k]);
  CopyGeometry(grid.transform(), box.min(), &volume.metadata);

  volume.voxels = std::make_unique<float[]>(static_cast<std::size_t>(size[0] * size[1] * size[2]));
  openvdb::tools::Dense<float, openvdb::tools::LayoutXYZ> dense(box, volume.voxels.get());
  openvdb::tools::copyToDense(grid, dense);
  return volume;
}

}  // namespace

DenseVolume ReadVdbVolume(const std::filesystem::path& path, const ImportLimits& limits,
                          Reporter* reporter) {
  reporter->Progress(0.0, "reading");
  CheckReadable(path);
  openvdb::initialize();
  openvdb::GridBase::Ptr grid;
  try {
    grid = ReadOnlyGrid(path);
  } catch (const std::ios_base::failure&) {
    Refuse("this is no complete .vdb file; copy or download it again");
  } catch (const openvdb::Exception& error) {
    Refuse(std::string("this is no .vdb file that can be read (") + error.what() + ")");
  } catch (const std::length_error&) {
    Refuse("the .vdb file is damaged; copy or download it again");
  }
  reporter->Progress(0.4, "reading");
  if (grid->isType<openvdb::FloatGrid>()) {
    return FromGrid(*openvdb::gridPtrCast<openvdb::FloatGrid>(grid), "float32", limits);
  }
  if (grid->isType<openvdb::DoubleGrid>()) {
    return FromGrid(*openvdb::gridPtrCast<openvdb::DoubleGrid>(grid), "float64", limits);
  }
  if (grid->isType<openvdb::Int32Grid>()) {
    return FromGrid(*openvdb::gridPtrCast<openvdb::Int32Grid>(grid), "int32", limits);
  }
  if (grid->isType<openvdb::Int64Grid>()) {
    return FromGrid(*openvdb::gridPtrCast<openvdb::Int64Grid>(grid), "int64", limits);
  }
  if (grid->isType<openvdb::BoolGrid>()) {
    return FromGrid(*openvdb::gridPtrCast<openvdb::BoolGrid>(grid), "bool", limits);
  }
  Refuse("a grid of type " + Quoted(grid->valueType()) + " has no scalar voxels; convert it first");
}

}  // namespace palpate
