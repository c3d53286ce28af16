#include "client/files/download_file.h"

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <ios>
#include <memory>
#include <ostream>
#include <utility>

#include "client/sdk/nrrd_file.h"
#include "common/error/error.h"
#include "common/files/new_file.h"

// OpenVDB's library holds these classes compiled. Compiling them here, too, takes three times as
// long. But without optimisation, the compiler asks for functions that the library lacks.
#if defined(__OPTIMIZE__) && !defined(__clang__) && !defined(PALPATE_SANITIZED)

namespace openvdb {

OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {
extern template class Grid<FloatTree>;
extern template class tree::Tree<FloatTree::RootNodeType>;
extern template class Grid<Int32Tree>;
extern template class tree::Tree<Int32Tree::RootNodeType>;
}  // namespace OPENVDB_VERSION_NAME

}  // namespace openvdb

#endif

namespace palpate::client {
namespace {

constexpr std::int32_t kFormat = 2;
// The blocks of 8³ bricks along an edge of OpenVDB's nodes above its leaves, of 128³ voxels.
constexpr int kNodeBlocks = 2;
constexpr int kNodeEdge = kNodeBlocks * kBrickEdge * kBrickEdge;

bool IsLevelSet(const VolumeLattice& lattice) {
  return lattice.Background() == static_cast<float>(lattice.value_max);
}

// 0 is not -0: OpenVDB may write an inactive -0 as the background.
bool HaveSameBits(float one, float other) {
  return std::bit_cast<std::uint32_t>(one) == std::bit_cast<std::uint32_t>(other);
}

openvdb::Coord ToCoord(const Vec3i& at) { return {at.x(), at.y(), at.z()}; }

// Calls visit(place) for the places first <= place < end.
template <class Visit>
void ForEachPlace(const Vec3i& first, const Vec3i& end, const Visit& visit) {
  for (int a = first.x(); a < end.x(); ++a) {
    for (int b = first.y(); b < end.y(); ++b) {
      for (int c = first.z(); c < end.z(); ++c) visit(Vec3i(a, b, c));
    }
  }
}

template <class Grid>
class GridMaker {
 public:
  GridMaker(const BrickMap& bricks, const VolumeLattice& lattice,
            const std::function<void()>& check)
      : bricks_(bricks),
        size_(lattice.size),
        background_(lattice.Background()),
        is_level_set_(IsLevelSet(lattice)),
        check_(check),
        grid_(Grid::create(static_cast<Value>(background_))) {}

  typename Grid::Ptr Make() {
    const Vec3i nodes = (bricks_.block_count().array() + (kNodeBlocks - 1)) / kNodeBlocks;
    ForEachPlace(Vec3i::Zero(), nodes, [this](const Vec3i& node) {
      if (check_) check_();
      PutNode(node);
    });
    return std::move(grid_);
  }

 private:
  using Tree = typename Grid::TreeType;
  using Value = typename Grid::ValueType;
  using Leaf = typename Tree::LeafNodeType;

  bool IsBackground(float value) const { return HaveSameBits(value, background_); }
  bool IsActive(float value) const {
    return !IsBackground(value) && !(is_level_set_ && HaveSameBits(value, -background_));
  }

  // Adds a cube of one value as a tile. The level is that of the nodes that have such tiles.
  void PutTile(openvdb::Index level, const Vec3i& first, float value) {
    if (IsBackground(value)) return;
    grid_->tree().addTile(level, ToCoord(first), static_cast<Value>(value), IsActive(value));
  }

  void PutNode(const Vec3i& node) {
    const Vec3i first = node * kNodeBlocks;
    const Vec3i end = (first.array() + kNodeBlocks).min(bricks_.block_count().array());
    const TypedBrickPtr& only = bricks_.Only(first);
    bool is_one =
        only && only->is_constant() && ((node.array() + 1) * kNodeEdge <= size_.array()).all();
    ForEachPlace(first, end,
                 [&](const Vec3i& block) { is_one = is_one && bricks_.Only(block) == only; });
    if (is_one) {
      PutTile(Leaf::LEVEL + 2, node * kNodeEdge, (*only)[0]);
    } else {
      ForEachPlace(first, end, [this](const Vec3i& block) { PutBlock(block); });
    }
  }

  void PutBlock(const Vec3i& block) {
    const TypedBrickPtr& only = bricks_.Only(block);
    if (only && only->is_constant() && IsBackground((*only)[0])) return;
    const Vec3i first = block * kBrickEdge;
    const Vec3i end = (first.array() + kBrickEdge).min(bricks_.brick_count().array());
    ForEachPlace(first, end, [this](const Vec3i& brick) { PutBrick(brick); });
  }

  void PutBrick(const Vec3i& place) {
    const TypedBrick& brick = *bricks_.At(place);
    const Vec3i first = place * kBrickEdge;
    const bool is_whole = ((first.array() + kBrickEdge) <= size_.array()).all();
    if (brick.is_constant() && (is_whole || IsBackground(brick[0]))) {
      PutTile(Leaf::LEVEL + 1, first, brick[0]);
      return;
    }
    auto leaf = std::make_unique<Leaf>(ToCoord(first), static_cast<Value>(background_), false);
    if (Fill(brick, size_ - first, *leaf)) grid_->tree().addLeaf(leaf.release());
  }

  // Leaves out voxels beyond the lattice, whatever the brick holds there. Returns false if all is
  // background.
  bool Fill(const TypedBrick& brick, const Vec3i& end, Leaf& leaf) const {
    bool has_values = false;
    for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
      const auto place = static_cast<int>(n);
      if (place >> 6 >= end.x() || (place >> 3 & 7) >= end.y() || (place & 7) >= end.z()) continue;
      const float value = brick[n];
      if (IsBackground(value)) continue;
      has_values = true;
      leaf.setValueOnly(n, static_cast<Value>(value));
      if (IsActive(value)) leaf.setValueOn(n);
    }
    return has_values;
  }

  const BrickMap& bricks_;
  const Vec3i size_;
  const float background_;
  const bool is_level_set_;
  const std::function<void()>& check_;
  typename Grid::Ptr grid_;
};

openvdb::math::Transform::Ptr TransformOf(const VolumeLattice& lattice) {
  openvdb::Mat4d matrix = openvdb::Mat4d::identity();
  for (int row = 0; row < 3; ++row) {
    // OpenVDB multiplies row vectors from the left, so the matrix is transposed.
    for (int col = 0; col < 3; ++col) matrix(col, row) = lattice.X_WI.linear(row, col);
    matrix(3, row) = lattice.X_WI.translation[row];
  }
  return openvdb::math::Transform::createLinearTransform(matrix);
}

void Describe(const VolumeLattice& lattice, const VdbOrigin& origin, openvdb::GridBase& grid) {
  grid.setName(IsLevelSet(lattice) ? "surface" : "density");
  if (IsLevelSet(lattice)) grid.setGridClass(openvdb::GRID_LEVEL_SET);
  grid.setTransform(TransformOf(lattice));
  const auto text = [&grid](const char* name, const std::string& value) {
    grid.insertMeta(name, openvdb::StringMetadata(value));
  };
  const Vec3i& size = lattice.size;
  grid.insertMeta("palpate_format", openvdb::Int32Metadata(kFormat));
  grid.insertMeta("palpate_size", openvdb::Vec3IMetadata({size.x(), size.y(), size.z()}));
  grid.insertMeta("palpate_value_min", openvdb::DoubleMetadata(lattice.value_min));
  grid.insertMeta("palpate_value_max", openvdb::DoubleMetadata(lattice.value_max));
  grid.insertMeta("palpate_frames", openvdb::Int32Metadata(origin.frames));
  text("palpate_unit", lattice.unit);
  text("palpate_original_type",
       origin.original_type.empty() ? std::string(Name(lattice.type)) : origin.original_type);
  text("palpate_source", lattice.source);
  if (!origin.patient_axes.empty()) text("palpate_patient_axes", origin.patient_axes);
}

// A file that calls `check` now and then.
class CheckedFile : public std::filebuf {
 public:
  explicit CheckedFile(const std::function<void()>& check) : check_(check) {}

 protected:
  std::streamsize xsputn(const char* data, std::streamsize size) override {
    if (check_) check_();
    return std::filebuf::xsputn(data, size);
  }

 private:
  const std::function<void()>& check_;
};

void WriteGrid(const std::filesystem::path& path, const openvdb::GridBase::Ptr& grid,
               const std::function<void()>& check) {
  CheckedFile file(check);
  std::ostream out(&file);
  // OpenVDB does not check whether its writes succeeded, so the stream throws.
  out.exceptions(std::ios::badbit | std::ios::failbit);
  if (!file.open(path, std::ios::out | std::ios::binary | std::ios::trunc)) {
    throw std::ios_base::failure("open");
  }
  openvdb::io::Stream stream(out);
  stream.setCompression(openvdb::io::COMPRESS_BLOSC | openvdb::io::COMPRESS_ACTIVE_MASK);
  stream.write(openvdb::GridCPtrVec{grid});
  if (!file.close()) throw std::ios_base::failure("close");
}

}  // namespace

void SaveAsVdb(const BrickMap& bricks, const VolumeLattice& lattice, const VdbOrigin& origin,
               const std::string& path, bool overwrite, const std::function<void()>& check) {
  CheckNewFile(path, ReplacesIf(overwrite));
  openvdb::initialize();
  openvdb::GridBase::Ptr grid;
  if (bricks.SmallestType() == LeafType::kFloat) {
    grid = GridMaker<openvdb::FloatGrid>(bricks, lattice, check).Make();
  } else {
    grid = GridMaker<openvdb::Int32Grid>(bricks, lattice, check).Make();
  }
  Describe(lattice, origin, *grid);
  WriteWhole(
      path, [&](const std::filesystem::path& partial) { WriteGrid(partial, grid, check); },
      ReplacesIf(overwrite));
}

namespace {

enum class Format { kNrrd, kVdb };

Format FormatOf(const std::string& file) {
  std::string suffix = std::filesystem::path(file).extension();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (suffix == ".nrrd") return Format::kNrrd;
  if (suffix == ".vdb") return Format::kVdb;
  throw Error(ErrorKind::kInvalidArgument,
              file + ": the name must end with .nrrd or .vdb, which says the format");
}

// Before the transfer, so that nobody waits for it in vain. The file's type is not known yet: edits
// and import may make it larger or smaller than the original's, but all of floats stay floats.
void CheckSize(const VolumeInfo& volume) {
  const bool has_floats = volume.original_type.starts_with("float");
  CheckNrrdSize(volume.size, has_floats ? LeafType::kFloat : LeafType::kUint8);
}

DownloadResult Fetch(Calls& palpated, const ProgressFunction& progress) {
  try {
    return palpated.DownloadVolume(progress);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kCancelled) throw;
    throw Error(ErrorKind::kCancelled, "the download was cancelled; no file was written");
  }
}

void Write(const VolumeMirror& copy, const VolumeInfo& before, Format format,
           const std::string& file, bool overwrite, const std::function<void()>& check) {
  if (format == Format::kNrrd) {
    SaveAsNrrd(copy, file, overwrite, check);
    return;
  }
  VdbOrigin origin;
  // Another volume may have been loaded since.
  if (before.loaded_revision == copy.lattice()->loaded_revision) {
    origin = {before.original_type, static_cast<int>(before.frames),
              before.patient_axes_answered ? "" : before.patient_axes};
  }
  SaveAsVdb(copy.bricks(), *copy.lattice(), origin, file, overwrite, check);
}

}  // namespace

DownloadedFile DownloadToFile(Calls& palpated, const std::string& file, bool overwrite,
                              const ProgressFunction& progress,
                              const std::function<void()>& check) {
  const Format format = FormatOf(file);
  // Check the path before the volume is transferred.
  CheckNewFile(file, ReplacesIf(overwrite));
  const VolumeInfo before = palpated.GetVolume();
  if (format == Format::kNrrd) CheckSize(before);
  const auto begin = std::chrono::steady_clock::now();
  DownloadedFile file_written{.copy = Fetch(palpated, progress)};
  file_written.received_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  if (file_written.copy.volume.placement()->replayed) {
    throw Error(
        ErrorKind::kConflict,
        "a recording is replayed, and what came is the recorded volume: no file was written");
  }
  Write(file_written.copy.volume, before, format, file, overwrite, check);
  return file_written;
}

}  // namespace palpate::client
