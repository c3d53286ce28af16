// Changed bricks, to bytes and back.
//
//   edit = tick:u64 base_revision:u64 volume_revision:u64 count:u32 number:u64*
//          planes of the voxels
//
// The voxels' four bytes are kept apart, the lowest ones of all voxels first: of
// voxels that came from integers, or that an edit made equal, most planes are runs.
//
// Threads: pure. Not for real-time code.
#pragma once

#include <string>
#include <string_view>

#include "server/recording/recording.h"

namespace palpate {

// Numbers are ascending. kInvalidArgument for more than kBricksPerEdit, or none.
std::string EncodeEdit(const RecordedEdit& edit);
// Throws DamagedBytes.
RecordedEdit DecodeEdit(std::string_view bytes);

}  // namespace palpate
