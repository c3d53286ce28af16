// A volume on the graphics card: a cache of the cell bricks that pictures want.
//
// Two levels. Fine: a cell brick's corners, in a slot of an atlas. Coarse: for each block that
// varies, the first corners of its cell bricks. Coarse slots are always there. A cell brick without
// a fine slot is drawn as one trilinear cell between its coarse corners, so there is always a whole
// picture.
//
// The shaders mark the cell bricks whose voxels they use, or would use if they were there. After a
// picture, EndPicture reads the marks; the next TakeUp uploads what is missing, the nearest first;
// and the picture is drawn again. Marked bricks stay. If memory is full, bricks that no picture
// wants make room, those not wanted for longest first; then far ones make room for nearer ones.
//
// On the card (volume_desktop.glsl of client/shading):
// - blocks: of each block its range, its table and its coarse slot
// - ranges and slots: a table of 8³ cell bricks for each block that varies
// - atlas: the slots
// - marks: a bit per cell brick of a table
// The range of a cell brick includes all values that the card shows there.
//
// Threads: that of the current OpenGL 4.3 context. Its state must be as ResetState leaves it.
// Errors: kTooLarge if the card does not even hold the coarse level. It is thrown once; there is no
// volume then until another one begins.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "client/view/render/card_memory.h"
#include "client/view/volume/view_volume.h"
#include "common/geometry/geometry.h"

namespace palpate::view {

// Scales a volume's values for computations on a graphics card: by a power of two, so that the
// largest is near 2^32 for any unit. The squares of the values then fit a float, and so do the
// squares of differences 10^-28 times as large.
//
// A power of two changes no digit, so the order of values stays the same. Only values 10^47 times
// smaller than the largest are lost. Values beyond the volume's first range are limited to 2^50.
//
// Threads: plain values, pure.
class ValueScale {
 public:
  ValueScale() = default;
  // For values between the two, in data units.
  ValueScale(double min, double max);

  // The power of two.
  double factor() const { return factor_; }
  double Scaled(double value) const;
  float Scaled(float value) const { return static_cast<float>(Scaled(static_cast<double>(value))); }
  // Splits a value that is compared with others. The first part is the greatest scaled float that
  // is not above the value. The second part is the rest, as a float that is not above it. A float
  // is above the value exactly if it is above the first part. The difference to both parts together
  // is as exact as with doubles.
  Eigen::Vector2d Split(double value) const;

 private:
  double factor_ = 1.0;
};

class BrickCache {
 public:
  // No slot, or no table.
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  // Pictures 0 to 2 are slices.
  static constexpr int kSurface = 3;
  static constexpr int kPictures = 4;

  // For all buffers and textures of the volume. The coarse level may exceed it.
  explicit BrickCache(std::size_t budget_bytes);
  BrickCache(const BrickCache&) = delete;
  BrickCache& operator=(const BrickCache&) = delete;

  // Takes up all changes, and uploads at most `most_bricks` fine bricks. Returns true if no brick
  // waits that the last pictures want. `volume` must always be the same object.
  bool TakeUp(ViewVolume& volume, std::size_t most_bricks);
  // True if the pictures want more than the memory holds: some of it is shown coarsely.
  bool is_full() const { return is_full_; }
  // True if TakeUp has nothing to upload for the pictures so far.
  bool is_settled() const { return !is_plan_due_ && missing_.empty(); }
  std::size_t bytes() const;
  std::uint64_t uploaded_bricks() const { return uploaded_; }

  bool has_volume() const { return atlas_.capacity() > 0; }
  const Vec3i& size() const { return size_; }  // of the lattice, voxels
  const Vec3i& block_count() const { return block_count_; }
  const ValueScale& scale() const { return scale_; }  // maps values to those of shaders
  float background() const { return background_; }
  double value_min() const { return value_min_; }
  double value_max() const { return value_max_; }
  const std::optional<AffineMap>& X_DI() const { return X_DI_; }

  // Rises with every change on the card.
  std::uint64_t version() const { return version_; }
  // Rises if a finished pixel may look different. Otherwise only missing bricks have come.
  std::uint64_t content_version() const { return content_version_; }

  const BrickAtlas& atlas() const { return atlas_; }
  const CardBuffer& blocks() const { return card_blocks_; }
  const CardBuffer& ranges() const { return card_ranges_; }
  const CardBuffer& slots() const { return card_slots_; }
  const CardBuffer& marks() const { return marks_; }

  // Before and after a picture is drawn. EndPicture returns how many of the marked bricks are
  // missing. kMore: the picture goes on, and what it wanted before is still wanted.
  enum class Marks { kNewView, kAgain, kMore };
  void BeginPicture() const { marks_.Clear(); }
  std::size_t EndPicture(int picture, Marks marks, const std::optional<Vec3>& eye_I);
  // The picture is not shown any more.
  void Forget(int picture);

 private:
  // Owners of slots are entries, or tables with the bit kCoarse: the slot is coarse.
  static constexpr std::uint64_t kNobody = ~std::uint64_t{0};
  static constexpr std::uint64_t kCoarse = std::uint64_t{1} << 63;
  static bool IsFine(std::uint64_t owner) { return (owner & kCoarse) == 0; }

  struct CardBlock {
    float min = 0.0f;
    float max = 0.0f;
    std::uint32_t table = kNone;
    std::uint32_t coarse = kNone;
  };
  struct Picture {
    std::vector<std::uint64_t> wanted{};  // a bit per entry
    std::optional<Vec3> eye_I{};
  };
  struct Missing {
    double distance = 0.0;
    std::uint32_t entry = 0;
  };

  void Begin(const ViewVolume& volume, LeafType type);
  void TurnIntoFloats();
  void Release();
  void TakeUpPlacement(const ViewVolume& volume);

  void TakeBlocks(const ViewVolume& volume, std::span<const VolumeChanges::Block> blocks,
                  std::size_t most_bricks);
  void TakeBlock(const ViewVolume& volume, const VolumeChanges::Block& block,
                 std::size_t& most_bricks);
  void MakeTable(std::uint64_t block);
  void DropTable(std::uint64_t block);
  void WriteRanges(const CellBlock& block, std::uint32_t table, const CellBricks& bricks) const;
  void TakeFineBricks(const ViewVolume& volume, std::uint64_t block, const CellBricks& bricks,
                      std::size_t& most_bricks);

  // Slots
  std::size_t MostSlots() const;
  void MakeRoom(std::size_t slots, bool beyond_budget);
  bool Allocate(std::size_t slots);
  std::uint32_t NewSlot(std::uint64_t owner);
  void FreeSlot(std::uint32_t slot);
  void Evict(std::uint32_t slot);

  // What is to be uploaded
  void Plan(const ViewVolume& volume);
  std::vector<Missing> FindMissing(const ViewVolume& volume) const;
  void EvictOldest(std::size_t slots, bool also_wanted);
  void EvictFarther();
  bool IsWanted(std::uint32_t entry) const;
  double DistanceOf(std::uint32_t entry) const;
  Vec3i CellBrickOf(std::uint32_t entry) const;

  bool Flush(const ViewVolume& volume);
  bool UploadPending(const ViewVolume& volume);
  template <class T>
  bool UploadRun(const ViewVolume& volume, std::span<const std::uint32_t> slots);
  void WriteEntries();
  void WriteBlocks();

  std::size_t budget_bytes_;
  std::size_t most_slots_ = 0;  // that the driver gives
  Vec3i size_ = Vec3i::Zero();
  Vec3i block_count_ = Vec3i::Zero();
  ValueScale scale_;
  float background_ = 0.0f;  // scaled
  double value_min_ = 0.0;
  double value_max_ = 1.0;
  std::optional<AffineMap> X_DI_;
  std::uint64_t version_ = 0;
  std::uint64_t content_version_ = 0;

  BrickAtlas atlas_;
  CardBuffer card_blocks_;
  CardBuffer card_ranges_;
  CardBuffer card_slots_;
  CardBuffer marks_;

  std::vector<CardBlock> blocks_;           // as on the card
  std::vector<std::uint64_t> table_block_;  // of each table
  std::vector<std::uint32_t> free_tables_;
  std::vector<std::uint32_t> slots_;       // of each entry: place in a table
  std::vector<std::uint64_t> owners_;      // of each slot
  std::vector<std::uint32_t> free_slots_;  // the next one is last
  std::vector<std::uint64_t> wanted_at_;   // of each slot: the last picture that wanted it
  std::size_t coarse_slots_ = 0;

  std::vector<std::uint32_t> pending_;          // slots whose values are not on the card yet
  std::vector<std::uint32_t> changed_entries_;  // not on the card yet
  std::vector<std::uint64_t> changed_blocks_;
  std::vector<std::byte> staging_;

  std::array<Picture, kPictures> pictures_;
  std::uint64_t picture_number_ = 0;
  bool is_plan_due_ = false;
  int exchanges_ = 0;  // of far bricks for nearer ones, for the present view
  bool is_full_ = false;
  std::vector<Missing> missing_;  // the nearest is last
  std::uint64_t uploaded_ = 0;
};

}  // namespace palpate::view
