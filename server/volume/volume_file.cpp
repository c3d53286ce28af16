#include "server/volume/volume_file.h"

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <limits>
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
constexpr std::size_t kLongestText = 4096;
constexpr double kFrameTolerance = 1e-3;

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

openvdb::FloatGrid::Ptr ReadGrid(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(ErrorKind::kNotFound, "there is no such file that can be read");
  // Else a truncated file would be read as if zeros followed.
  in.exceptions(std::ios::badbit | std::ios::failbit);
  openvdb::io::Stream stream(in, /*delayLoad=*/false);
  const openvdb::GridPtrVecPtr grids = stream.getGrids();
  if (grids->size() != 1 || !(*grids)[0]->isType<openvdb::FloatGrid>() ||
      (*grids)[0]->getName() != kGridName) {
    Refuse("this .vdb file does not hold one grid 'density' of floats; import it first");
  }
  return openvdb::gridPtrCast<openvdb::FloatGrid>((*grids)[0]);
}

VolumeFile ReadChecked(const std::filesystem::path& path) {
  VolumeFile file;
  file.grid = ReadGrid(path);
  file.metadata = ExtractMetadata(*file.grid);
  CheckVolumeMetadata(file.metadata);
  CheckTree(*file.grid, file.metadata);
  if (*file.grid->transformPtr() != *GridTransform(file.metadata)) {
    Refuse("the grid's transform is not that of its metadata; import the volume again");
  }
  return file;
}

}  // namespace

void CheckVolumeMetadata(const VolumeMetadata& metadata) {
  constexpr int kLongestAxis = std::numeric_limits<int>::max() / 2;
  if (metadata.size.minCoeff() < 2 || metadata.size.maxCoeff() > kLongestAxis) {
    Refuse("the size is not that of a volume; every axis needs at least two voxels");
  }
  for (const double spacing : metadata.spacing_mm) {
    if (!(spacing >= kLeastSpacingMm && spacing <= kGreatestSpacingMm)) {
      Refuse("the voxel spacing " + std::to_string(spacing) +
             " mm is not between 0.0001 and 1000000 mm; state another one (spacing-mm)");
    }
  }
  if (!metadata.origin_W_mm.allFinite() || metadata.origin_W_mm.cwiseAbs().maxCoeff() > 1e9) {
    Refuse("the origin is not finite; correct the file");
  }
  const Mat3 gram = metadata.direction.transpose() * metadata.direction;
  if (!gram.allFinite() || !gram.isApprox(Mat3::Identity(), kFrameTolerance)) {
    Refuse("the axes are not at right angles (sheared); resample the volume first");
  }
  if (!std::isfinite(metadata.value_min) || !std::isfinite(metadata.value_max) ||
      !(metadata.value_min < metadata.value_max)) {
    Refuse("all voxels have the same value (constant volume); there is nothing to feel");
  }
  if (metadata.frames < 1) Refuse("the number of frames is not positive; correct the file");
  for (const std::string* text : {&metadata.unit, &metadata.original_type, &metadata.source}) {
    if (text->size() > kLongestText) Refuse("a text of the metadata is too long");
  }
}

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

VolumeFile ReadVolumeFile(const std::filesystem::path& path) {
  openvdb::initialize();
  try {
    return ReadChecked(path);
  } catch (const Error& error) {
    throw Error(error.kind(), path.string() + ": " + error.what());
  } catch (const std::bad_alloc&) {
    throw Error(ErrorKind::kTooLarge, path.string() + ": there is not enough memory to read it");
  } catch (const std::exception&) {
    Refuse(path.string() + ": the file is damaged or incomplete; import the volume again");
  }
}

}  // namespace palpate
