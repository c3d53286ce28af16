#include "server/volume/save/volume_file.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <system_error>

#include <openvdb/io/Stream.h>

#include "server/volume/snapshot/grid_tree.h"
#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate {
namespace {

constexpr std::int32_t kFormat = 2;
constexpr char kGridName[] = "density";

openvdb::math::Transform::Ptr GridTransform(const VolumeMetadata& metadata) {
  const AffineMap X_WI = metadata.WorldFromIndex();
  openvdb::Mat4d matrix = openvdb::Mat4d::identity();
  for (int row = 0; row < 3; ++row) {
    // OpenVDB multiplies row vectors from the left, so the matrix is transposed.
    for (int col = 0; col < 3; ++col) matrix(col, row) = X_WI.linear(row, col);
    matrix(3, row) = X_WI.translation[row];
  }
  // The volume's first voxel is not voxel (0,0,0) of the grid.
  if (metadata.grid_form) {
    const Vec3 shift = X_WI.linear * metadata.grid_form->first.cast<double>();
    for (int row = 0; row < 3; ++row) matrix(3, row) -= shift[row];
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
  const Vec3i first = metadata.grid_form ? metadata.grid_form->first : Vec3i::Zero();
  map->insertMeta("palpate_first",
                  openvdb::Vec3IMetadata(openvdb::Vec3i(first.x(), first.y(), first.z())));
  map->insertMeta("palpate_spacing_mm", openvdb::Vec3DMetadata(ToVdb(metadata.spacing_mm)));
  map->insertMeta("palpate_origin_mm", openvdb::Vec3DMetadata(ToVdb(metadata.origin_W_mm)));
  map->insertMeta("palpate_direction", openvdb::Mat4DMetadata(direction));
  map->insertMeta("palpate_value_min", openvdb::DoubleMetadata(metadata.value_min));
  map->insertMeta("palpate_value_max", openvdb::DoubleMetadata(metadata.value_max));
  map->insertMeta("palpate_frames", openvdb::Int32Metadata(metadata.frames));
  map->insertMeta("palpate_unit", openvdb::StringMetadata(metadata.unit));
  // Only if known, as in files of older versions.
  if (!metadata.patient_axes.empty()) {
    map->insertMeta("palpate_patient_axes", openvdb::StringMetadata(metadata.patient_axes));
  }
  if (metadata.is_level_set && !metadata.grid_form) {
    map->insertMeta(
        openvdb::GridBase::META_GRID_CLASS,
        openvdb::StringMetadata(openvdb::GridBase::gridClassToString(openvdb::GRID_LEVEL_SET)));
  }
  map->insertMeta("palpate_original_type", openvdb::StringMetadata(metadata.original_type));
  map->insertMeta("palpate_source", openvdb::StringMetadata(metadata.source));
}

openvdb::math::MapBase::Ptr MapOf(std::string_view type, const openvdb::Mat4d& matrix) {
  using namespace openvdb::math;
  const Vec3d scale(matrix(0, 0), matrix(1, 1), matrix(2, 2));
  const Vec3d shift(matrix(3, 0), matrix(3, 1), matrix(3, 2));
  if (type == "UniformScaleMap") return std::make_shared<UniformScaleMap>(scale[0]);
  if (type == "UniformScaleTranslateMap") {
    return std::make_shared<UniformScaleTranslateMap>(scale[0], shift);
  }
  if (type == "ScaleMap") return std::make_shared<ScaleMap>(scale);
  if (type == "ScaleTranslateMap") return std::make_shared<ScaleTranslateMap>(scale, shift);
  if (type == "TranslationMap") return std::make_shared<TranslationMap>(shift);
  if (type == "UnitaryMap") return std::make_shared<UnitaryMap>(matrix);
  return std::make_shared<openvdb::math::AffineMap>(matrix);
}

openvdb::math::Transform::Ptr TransformOf(const VolumeMetadata& metadata) {
  const GridForm* const form = metadata.grid_form.get();
  if (!form || form->map.empty()) return GridTransform(metadata);
  return std::make_shared<openvdb::math::Transform>(
      MapOf(form->map, openvdb::Mat4d(form->matrix.data())));
}

template <class T>
openvdb::Metadata::Ptr MetadataOf(const std::string& bytes) {
  T value;
  std::memcpy(&value, bytes.data(), sizeof value);
  return std::make_shared<openvdb::TypedMetadata<T>>(value);
}

// In the order of kGridEntryTypes.
constexpr openvdb::Metadata::Ptr (*kMakers[])(const std::string& bytes) = {
    [](const std::string& bytes) -> openvdb::Metadata::Ptr {
      return std::make_shared<openvdb::StringMetadata>(bytes);
    },
    MetadataOf<bool>,
    MetadataOf<openvdb::Int32>,
    MetadataOf<openvdb::Int64>,
    MetadataOf<float>,
    MetadataOf<double>,
    MetadataOf<openvdb::Vec2i>,
    MetadataOf<openvdb::Vec2s>,
    MetadataOf<openvdb::Vec2d>,
    MetadataOf<openvdb::Vec3i>,
    MetadataOf<openvdb::Vec3s>,
    MetadataOf<openvdb::Vec3d>,
    MetadataOf<openvdb::Vec4i>,
    MetadataOf<openvdb::Vec4s>,
    MetadataOf<openvdb::Vec4d>,
    MetadataOf<openvdb::Mat4s>,
    MetadataOf<openvdb::Mat4d>,
};
static_assert(std::size(kMakers) == std::size(kGridEntryTypes));

void InsertEntries(const GridForm& form, openvdb::MetaMap* map) {
  for (const GridEntry& entry : form.entries) {
    map->insertMeta(entry.name, *kMakers[entry.type - kGridEntryTypes](entry.bytes));
  }
}

// A file that reports every MiB which fraction of `most_bytes` it has. The compressed size is not
// known in advance.
class ToldFile : public std::filebuf {
 public:
  ToldFile(const std::function<void(double)>& written, std::uint64_t most_bytes)
      : written_(written), most_bytes_(static_cast<double>(most_bytes)) {}

 protected:
  std::streamsize xsputn(const char* data, std::streamsize size) override {
    bytes_ += static_cast<std::uint64_t>(size);
    if (written_ && bytes_ >> 20 != told_ >> 20) {
      told_ = bytes_;
      written_(std::min(1.0, static_cast<double>(bytes_) / most_bytes_));
    }
    return std::filebuf::xsputn(data, size);
  }

 private:
  const std::function<void(double)>& written_;
  const double most_bytes_;
  std::uint64_t bytes_ = 0;
  std::uint64_t told_ = 0;
};

openvdb::GridBase::Ptr GridOf(std::string_view type, const NextLeaf& next,
                              const VolumeMetadata& metadata) {
  if (type == "double") return MakeGrid<openvdb::DoubleGrid>(next, metadata);
  if (type == "int32") return MakeGrid<openvdb::Int32Grid>(next, metadata);
  if (type == "int64") return MakeGrid<openvdb::Int64Grid>(next, metadata);
  if (type == "bool") return MakeGrid<openvdb::BoolGrid>(next, metadata);
  return MakeGrid<openvdb::FloatGrid>(next, metadata);
}

}  // namespace

void WriteGridFile(const std::filesystem::path& path, std::string_view type, const NextLeaf& next,
                   const VolumeMetadata& metadata, const std::function<void(double)>& written) {
  openvdb::initialize();
  const openvdb::GridBase::Ptr grid = GridOf(type, next, metadata);
  if (metadata.grid_form) {
    InsertEntries(*metadata.grid_form, grid.get());
  } else {
    grid->setName(kGridName);
  }
  grid->setTransform(TransformOf(metadata));
  InsertMetadata(metadata, grid.get());

  ToldFile file(written, grid->memUsage());
  std::ostream out(&file);
  // OpenVDB does not check whether its writes succeeded, so the stream throws.
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

void WriteVolumeFile(const std::filesystem::path& path, const BrickDirectory& bricks,
                     const VolumeMetadata& metadata, IfThere if_there) {
  CheckVolumeMetadata(metadata);
  const auto write = [&](const std::filesystem::path& partial) {
    WriteGridFile(partial, GridTypeOf(bricks, metadata), LeavesOf(bricks), metadata, {});
  };
  WriteWhole(path, write, if_there, Durable::kNo);
}

}  // namespace palpate
