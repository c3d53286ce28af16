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
#include "client/web/volume/blob_shelf.h"
#include "client/web/volume/group.h"
#include "client/web/volume/overview.h"

namespace palpate::web {

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
