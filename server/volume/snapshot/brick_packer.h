// Puts leaves into messages of a volume (volume_event.h), and takes them out again.
//
// Threads: one per object; UnpackBricks is pure. Not for real-time code.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/bricks/volume_event.h"
#include "server/volume/snapshot/leaf.h"

namespace palpate {

// Puts leaves into a message until it is full. Leaves of one value become tiles.
class BrickPacker {
 public:
  // Of voxels, not packed; the last brick may go beyond.
  static constexpr std::size_t kBytesPerMessage = std::size_t{128} << 10;

  // Returns false if the leaf needs another message. Numbers ascend.
  bool Add(std::uint64_t number, const Leaf& leaf);
  VolumeBricks Take();

 private:
  bool AddBrick(std::uint64_t number, const Leaf& leaf);
  bool AddTile(std::uint64_t number, float value);

  VolumeBricks bricks_;
  std::vector<std::byte> voxels_;
  std::uint64_t tile_bricks_ = 0;
};

// Calls take(number, leaf) for each brick of a message, tiles last. Throws Error(kInvalidArgument)
// for a message that no BrickPacker makes; its numbers may lie beyond the volume.
void UnpackBricks(const VolumeBricks& bricks,
                  const std::function<void(std::uint64_t number, LeafPtr leaf)>& take);

}  // namespace palpate
