#include "server/volume/volume_file.h"

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <ostream>
#include <string>
#include <system_error>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr std::int32_t kFormat = 2;
constexpr char kGridName[] = "density";

[[noreturn]] void Refuse(const std::string& message) {
  throw Error(ErrorKind::kInvalidArgument, message);
}

openvdb::math::Transform::Ptr GridTransform(const VolumeMetadata& metadata) {
  const AffineMap X_WI = metadata.WorldFromIndex();
  openvdb::Mat4d matrix = openvdb::Mat4d::identity();
  for (int row = 0; row < 3; ++row) {
    // OpenVDB multiplies row vectors from the left.
    for (int col = 0; col < 3; ++col) matrix(col, row) = X_WI.linear(row, col);
    matrix(3, row) = X_WI.translation[row];
  }
  return openvdb::math::Transform::createLinearTransform(matrix);
}

openvdb::Vec3d ToVdb(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

void InsertMetadata(const VolumeMetadata& metadata, openvdb::MetaMap* map) {
  openvdb::Mat4d direction = openvdb::Mat4d::identity();
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 3; ++col) direction(row, col) = metadata.direction(row, col);
  }
  map->insertMeta("palpate_format", openvdb::Int32Metadata(kFormat));
  map->insertMeta("palpate_size", openvdb::Vec3IMetadata(openvdb::Vec3i(
                                      metadata.size.x(), metadata.size.y(), metadata.size.z())));
  map->insertMeta("palpate_spacing_mm", openvdb::Vec3DMetadata(ToVdb(metadata.spacing_mm)));
  map->insertMeta("palpate_origin_mm", openvdb::Vec3DMetadata(ToVdb(metadata.origin_W_mm)));
  map->insertMeta("palpate_direction", openvdb::Mat4DMetadata(direction));
  map->insertMeta("palpate_value_min", openvdb::DoubleMetadata(metadata.value_min));
  map->insertMeta("palpate_value_max", openvdb::DoubleMetadata(metadata.value_max));
  map->insertMeta("palpate_frames", openvdb::Int32Metadata(metadata.frames));
  map->insertMeta("palpate_unit", openvdb::StringMetadata(metadata.unit));
  map->insertMeta("palpate_original_type", openvdb::StringMetadata(metadata.original_type));
  map->insertMeta("palpate_source", openvdb::StringMetadata(metadata.source));
}

// The tree must lie in the box of the metadata and fill the rest with the least
// value.
void CheckTree(const openvdb::FloatGrid& grid, const VolumeMetadata& metadata) {
  const openvdb::CoordBBox box(
      {0, 0, 0},
      openvdb::Coord(metadata.size.x(), metadata.size.y(), metadata.size.z()).offsetBy(-1));
  const openvdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
  if (!active.empty() && !box.isInside(active)) {
    Refuse("there are voxels outside of the stated size; import the volume again");
  }
  if (grid.background() != static_cast<float>(metadata.value_min)) {
    Refuse("the background is not the least value; import the volume again");
  }
}

// A file that tells how much is written, every MiB.
class ToldFile : public std::filebuf {
 public:
  explicit ToldFile(const std::function<void(std::uint64_t)>& written) : written_(written) {}

 protected:
  std::streamsize xsputn(const char* data, std::streamsize size) override {
    bytes_ += static_cast<std::uint64_t>(size);
    if (written_ && bytes_ >> 20 != told_ >> 20) {
      told_ = bytes_;
      written_(bytes_);
    }
    return std::filebuf::xsputn(data, size);
  }

 private:
  const std::function<void(std::uint64_t)>& written_;
  std::uint64_t bytes_ = 0;
  std::uint64_t told_ = 0;
};

void WriteGrid(const std::filesystem::path& path, const openvdb::FloatGrid::Ptr& grid,
               const WriteOptions& options) {
  ToldFile file(options.written);
  std::ostream out(&file);
  // OpenVDB does not look whether its writes succeeded.
  out.exceptions(std::ios::badbit | std::ios::failbit);
  const auto check = [](const void* done) {
    if (!done) throw std::ios_base::failure("write");
  };
  check(file.open(path, std::ios::out | std::ios::binary | std::ios::trunc));
  openvdb::io::Stream stream(out);
  stream.setCompression(openvdb::io::COMPRESS_BLOSC | openvdb::io::COMPRESS_ACTIVE_MASK);
  stream.write(openvdb::GridCPtrVec{grid});
  check(file.close());
}

}  // namespace

void WriteVolumeFile(const std::filesystem::path& path, const openvdb::FloatGrid& grid,
                     const VolumeMetadata& metadata, const WriteOptions& options) {
  openvdb::initialize();
  CheckVolumeMetadata(metadata);
  CheckTree(grid, metadata);
  const openvdb::FloatGrid::Ptr named =
      openvdb::FloatGrid::create(std::const_pointer_cast<openvdb::FloatTree>(grid.treePtr()));
  named->setName(kGridName);
  named->setTransform(GridTransform(metadata));
  InsertMetadata(metadata, named.get());

  const auto write = [&](const std::filesystem::path& partial) {
    WriteGrid(partial, named, options);
  };
  WriteWhole(path, write, options.if_there, options.durable, options.links);
}

}  // namespace palpate
