#include "tests/support/volume_file.h"

#include <cstdint>
#include <fstream>
#include <string>

#include <openvdb/io/Stream.h>

#include "common/error/error.h"
#include "server/volume/openvdb_grids.h"

namespace palpate {
namespace {

constexpr std::int32_t kFormat = 2;

[[noreturn]] void Refuse(const std::string& message) {
  throw Error(ErrorKind::kInvalidArgument, message);
}

template <typename T>
T Entry(const openvdb::MetaMap& map, const char* name) {
  const auto entry = map.getMetadata<openvdb::TypedMetadata<T>>(name);
  if (!entry) Refuse(std::string("the entry ") + name + " is missing; import the volume again");
  return entry->value();
}

VolumeMetadata ExtractMetadata(const openvdb::MetaMap& map) {
  const auto format = map.getMetadata<openvdb::Int32Metadata>("palpate_format");
  if (!format) Refuse("this .vdb file was not written by palpate-import; import it first");
  if (format->value() != kFormat) {
    Refuse("the format number is " + std::to_string(format->value()) + ", not " +
           std::to_string(kFormat) + "; import the volume again");
  }
  VolumeMetadata metadata;
  const auto size = Entry<openvdb::Vec3i>(map, "palpate_size");
  const auto spacing = Entry<openvdb::Vec3d>(map, "palpate_spacing_mm");
  const auto origin = Entry<openvdb::Vec3d>(map, "palpate_origin_mm");
  const auto direction = Entry<openvdb::Mat4d>(map, "palpate_direction");
  for (int row = 0; row < 3; ++row) {
    metadata.size[row] = size[row];
    metadata.spacing_mm[row] = spacing[row];
    metadata.origin_W_mm[row] = origin[row];
    for (int col = 0; col < 3; ++col) metadata.direction(row, col) = direction(row, col);
  }
  metadata.value_min = Entry<double>(map, "palpate_value_min");
  metadata.value_max = Entry<double>(map, "palpate_value_max");
  metadata.frames = Entry<std::int32_t>(map, "palpate_frames");
  metadata.unit = Entry<std::string>(map, "palpate_unit");
  metadata.original_type = Entry<std::string>(map, "palpate_original_type");
  metadata.source = Entry<std::string>(map, "palpate_source");
  return metadata;
}

// Voxel by voxel.
template <class Grid>
openvdb::FloatGrid::Ptr AsFloats(const openvdb::GridBase::Ptr& grid) {
  if (!grid->isType<Grid>()) return nullptr;
  const Grid& from = *openvdb::gridPtrCast<Grid>(grid);
  const auto to = openvdb::FloatGrid::create(static_cast<float>(from.background()));
  to->insertMeta(from);
  to->setTransform(from.transform().copy());
  for (auto value = from.cbeginValueAll(); value; ++value) {
    const auto is = static_cast<float>(value.getValue());
    if (value.isVoxelValue()) {
      if (value.isValueOn()) {
        to->tree().setValueOn(value.getCoord(), is);
      } else {
        to->tree().setValueOff(value.getCoord(), is);
      }
    } else if (value.isValueOn() || value.getValue() != from.background()) {
      to->tree().addTile(value.getLevel(), value.getCoord(), is, value.isValueOn());
    }
  }
  return to;
}

openvdb::FloatGrid::Ptr ReadGrid(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(ErrorKind::kNotFound, "there is no such file that can be read");
  // Else a truncated file would be read as if zeros followed.
  in.exceptions(std::ios::badbit | std::ios::failbit);
  openvdb::io::Stream stream(in, /*delayLoad=*/false);
  const openvdb::GridPtrVecPtr grids = stream.getGrids();
  if (grids->size() == 1) {
    const openvdb::GridBase::Ptr& grid = (*grids)[0];
    if (grid->isType<openvdb::FloatGrid>()) return openvdb::gridPtrCast<openvdb::FloatGrid>(grid);
    if (const auto floats = AsFloats<openvdb::DoubleGrid>(grid)) return floats;
    if (const auto floats = AsFloats<openvdb::Int32Grid>(grid)) return floats;
    if (const auto floats = AsFloats<openvdb::Int64Grid>(grid)) return floats;
    if (const auto floats = AsFloats<openvdb::BoolGrid>(grid)) return floats;
  }
  Refuse("this .vdb file does not hold one grid of scalars; import it first");
}

}  // namespace

VolumeFile ReadVolumeFile(const std::filesystem::path& path) {
  openvdb::initialize();
  VolumeFile file;
  file.grid = ReadGrid(path);
  file.metadata = ExtractMetadata(*file.grid);
  return file;
}

}  // namespace palpate
