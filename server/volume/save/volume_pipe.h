// Sends a volume from palpated to a palpate-import that saves it as .vdb.
//
// The bytes: HandoverHeader; for a volume from a .vdb file the parts of its grid's form, in the
// order and with the types of handover.h, where the leaves are those beyond the lattice;
// then all bricks, z fastest. A brick is a PipedLeaf and, unless it is constant, 64 bytes of states
// and 8³ voxels of its type.
//
// Not for real-time code. Threads: one each. Errors: Error.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>

#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

struct PipedLeaf {
  std::uint8_t type;  // LeafType
  std::uint8_t is_constant;
  std::uint8_t is_active;  // of a constant one
  std::uint8_t reserved;
  float value;  // of a constant one
};

// The volume must outlive it.
class VolumeSender {
 public:
  VolumeSender(const BrickDirectory& bricks, const VolumeMetadata& metadata);

  // Returns the next bytes, valid until the next call; none at the end.
  std::string_view Next();

 private:
  const BrickDirectory& bricks_;
  const std::uint64_t count_;
  std::uint64_t next_ = 0;  // brick
  std::string bytes_;
  bool is_begun_ = false;
};

struct ReceivedVolume {
  VolumeMetadata metadata;
  std::string_view grid_type;  // of kGridTypes
};

// Throws kInternal if palpated has ended.
ReceivedVolume ReceiveVolume(std::FILE* in);
// Of the next brick.
LeafPtr ReceiveLeaf(std::FILE* in);

}  // namespace palpate
