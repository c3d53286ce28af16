#include "server/volume/save/nrrd_writer.h"

#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <ios>
#include <string>
#include <vector>

#include "common/files/nrrd_header.h"

namespace palpate {
namespace {

// The smallest type that holds all voxels.
LeafType TypeOf(const BrickDirectory& bricks) {
  LeafType type = LeafType::kUint8;
  const Vec3i& count = bricks.brick_count();
  Vec3i b;
  for (b.x() = 0; b.x() < count.x(); ++b.x()) {
    for (b.y() = 0; b.y() < count.y(); ++b.y()) {
      for (b.z() = 0; b.z() < count.z(); ++b.z()) type = CommonType(type, bricks.At(b)->type());
    }
  }
  return type;
}

// Appends compressed data to a file.
class GzipTail {
 public:
  explicit GzipTail(const std::filesystem::path& path)
      // The fastest level: the other levels hardly make voxels smaller.
      : file_(gzopen(path.c_str(), "ab1")) {
    Check(file_ != nullptr);
    gzbuffer(file_, 1 << 20);
  }
  ~GzipTail() {
    if (file_) gzclose(file_);
  }
  GzipTail(const GzipTail&) = delete;
  GzipTail& operator=(const GzipTail&) = delete;

  template <class T>
  void Write(const std::vector<T>& values) {
    const std::size_t items = gzfwrite(values.data(), sizeof(T), values.size(), file_);
    Check(items == values.size());
  }
  void Close() {
    const gzFile file = file_;
    file_ = nullptr;
    Check(gzclose(file) == Z_OK);
  }

 private:
  static void Check(bool done) {
    if (!done) throw std::ios_base::failure("gzip");
  }
  gzFile file_;
};

// Fills in slice z, x fastest. T must hold every voxel.
template <class T>
void FillSlice(const VolumeSnapshot& volume, int z, std::vector<T>& slice) {
  const Vec3i& size = volume.size();
  const auto row = static_cast<std::size_t>(size.x());
  for (int x = 0; x < size.x(); x += kBrickEdge) {
    const int end = std::min(x + kBrickEdge, size.x());
    for (int y = 0; y < size.y(); ++y) {
      const Leaf& leaf = volume.bricks().Find(x, y, z);
      for (int i = x; i < end; ++i) {
        slice[static_cast<std::size_t>(y) * row + static_cast<std::size_t>(i)] =
            static_cast<T>(leaf[VoxelInBrick(i, y, z)]);
      }
    }
  }
}

template <class T>
void WriteVoxels(const VolumeSnapshot& volume, GzipTail& tail,
                 const std::function<void(double fraction)>& progress) {
  const Vec3i& size = volume.size();
  std::vector<T> slice(static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y()));
  for (int z = 0; z < size.z(); ++z) {
    progress(static_cast<double>(z) / size.z());
    FillSlice(volume, z, slice);
    tail.Write(slice);
  }
}

}  // namespace

void WriteNrrd(const std::filesystem::path& path, const VolumeSnapshot& volume,
               const std::function<void(double fraction)>& progress) {
  std::ofstream header;
  header.exceptions(std::ios::badbit | std::ios::failbit);
  header.open(path, std::ios::binary | std::ios::trunc);
  const LeafType type = TypeOf(volume.bricks());
  const VolumeMetadata& metadata = volume.metadata();
  header << ToText(NrrdHeader{.type = type == LeafType::kFloat ? "float" : std::string(Name(type)),
                              .encoding = "gzip",
                              .size = metadata.size,
                              .X_WI = metadata.WorldFromIndex(),
                              .is_lps = metadata.patient_axes == "LPS",
                              .unit = metadata.unit});
  header.close();
  GzipTail tail(path);
  VisitType(type, [&](auto voxel) { WriteVoxels<decltype(voxel)>(volume, tail, progress); });
  tail.Close();
}

}  // namespace palpate
