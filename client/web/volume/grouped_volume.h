// The volume as browsers fetch it: groups of voxels by content hash, an overview, and a manifest
// that names them all (manifest.h).
//
// A manifest is made of complete copies only, so its groups are one state of the daemon's volume.
// Only changed groups are read and hashed. Bricks are shared with the client's copy. A loaded
// volume replaces the last one when its copy is complete; until then the last one stays.
//
// Of superseded overviews, two are kept: they are large, and would else push out superseded groups.
//
// Frame: I, voxel indices. Threads: Find on any; all else on one. Errors: those of memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/sdk/volume_update.h"
#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "common/bricks/leaf_type.h"
#include "common/geometry/geometry.h"

namespace palpate::web {

// The volume at a low resolution: means of blocks of factor³ voxels, in the volume's type.
//
// Frame: I, voxel indices. Block (i, j, k) covers the voxels factor i to factor i + factor - 1
// along x, and likewise along y and z, so its centre is at index factor i + (factor - 1) / 2. It is
// at (i nj + j) nk + k. Blocks at the end of the lattice are means of the voxels within it. Means
// of integers are rounded. Values in data units. Threads: one.
class Overview {
 public:
  static constexpr int kMostBlocks = 128;  // along an axis

  Overview() = default;
  // Of a lattice of `size` voxels whose voxels have the value `background`. The factor is the
  // smallest power of two, from `least_factor` on, with at most kMostBlocks blocks along every
  // axis.
  Overview(const Vec3i& size, float background, int least_factor);

  int factor() const { return factor_; }
  const Vec3i& size() const { return size_; }  // blocks

  // The voxels of manifest.h's group (a, b, c).
  void PutGroup(const Vec3i& group, LeafType type, std::string_view bytes);
  void PutConstantGroup(const Vec3i& group, float value);
  // The means in this type, which must hold the volume's voxels. Only changed blocks are computed
  // again, unless the type is another one.
  const std::string& Bytes(LeafType type);

 private:
  // Sums are kept of cells, which are the blocks, or groups if blocks are larger than these.
  template <class Sum>
  void PutCells(const Vec3i& group, Sum sum);
  double Mean(const Vec3i& block) const;
  void Compute(const Vec3i& begin, const Vec3i& end);

  Vec3i lattice_ = Vec3i::Zero();
  int factor_ = 1;
  int cell_ = 1;  // voxels along an axis
  Vec3i size_ = Vec3i::Zero();
  Vec3i cells_ = Vec3i::Zero();
  std::vector<double> sums_;  // of cells
  LeafType type_ = LeafType::kUint8;
  std::string bytes_;           // empty: never computed
  std::vector<Vec3i> changed_;  // groups whose blocks in bytes_ are old
};

// What is announced of a manifest.
struct ManifestInfo {
  std::string name;
  VolumeRevision revision;
};

class GroupedVolume {
 public:
  using Time = BlobShelf::Time;

  // A small volume's overview must not be the volume itself if it is shown alone.
  static constexpr int kLeastFactorAlone = 4;

  // Without groups: the overview alone.
  explicit GroupedVolume(bool with_groups) : with_groups_(with_groups) {}

  // Takes every update of one client, in order. Returns the manifest if there is a new one. After
  // an exception (memory is short) the last manifest stays, and the next update makes everything
  // anew.
  std::optional<ManifestInfo> Apply(const client::VolumeUpdate& update, Time now);
  // Drops superseded blobs; Apply does so, too.
  void Expire(Time now) { shelf_.Expire(now); }

  BlobPtr Find(std::string_view name) const { return shelf_.Find(name); }
  const BlobShelf& shelf() const { return shelf_; }

 private:
  struct Place {         // of a group
    ContentHash hash{};  // zero: background
    LeafType type = LeafType::kUint8;
    bool is_dirty = true;
  };
  // The last group of one brick throughout: mostly many follow each other.
  struct Uniform {
    TypedBrickPtr brick;
    ContentHash hash{};
  };

  std::optional<ManifestInfo> Take(const client::VolumeUpdate& update, Time now);
  void Begin(const VolumeLattice& lattice, Time now);
  void Mark(const BrickRun& run);
  void MarkAll();
  void ReadTypes(const BrickMap& bricks);
  void ReadVoxels(const BrickMap& bricks, Time now);
  ContentHash Read(const BrickMap& bricks, const Vec3i& group, Uniform& last);
  TypedBrickPtr OnlyBrick(const BrickMap& bricks, const Vec3i& group) const;
  bool IsBackground(const TypedBrick& brick) const;
  LeafType VolumeType() const;
  Vec3i PlaceOf(std::size_t number) const;
  void PutOverview(Time now);
  std::string ManifestOf(const client::VolumeUpdate& update) const;
  void Replace(std::optional<ContentHash>& held, const ContentHash& hash,
               std::string_view content_type, std::string bytes, Time now);

  const bool with_groups_;
  BlobShelf shelf_;
  bool is_new_ = false;  // another volume began, and Begin was not called for it yet
  std::optional<VolumeLattice> lattice_;
  TypedBrickPtr background_;
  Vec3i group_count_ = Vec3i::Zero();
  std::vector<Place> groups_;
  std::vector<std::size_t> dirty_;                           // numbers of groups
  std::array<std::int64_t, std::size(kLeafTypes)> types_{};  // groups of each type
  LeafType type_ = LeafType::kUint8;
  Overview overview_;
  std::optional<ContentHash> overview_name_, manifest_name_;
  std::deque<ContentHash> old_overviews_;   // superseded, oldest first
  std::optional<VolumeRevision> revision_;  // of the manifest
};

}  // namespace palpate::web
