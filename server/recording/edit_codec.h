// Converts changed bricks to bytes and back.
//
//   edit = tick:u64 base_revision:u64 volume_revision:u64 count:u32 number:u64*
//          planes of the voxels
//
// The four bytes of each voxel are stored in four separate planes, the lowest bytes of all voxels
// first. If voxels came from integers, or an edit made them equal, most planes are long runs of one
// byte.
//
// Threads: pure. Not for real-time code.
#pragma once

#include <string>
#include <string_view>

#include "server/recording/recording.h"

namespace palpate {

// Numbers must be ascending. Throws kInvalidArgument for no brick or more than kBricksPerEdit
// bricks.
std::string EncodeEdit(const RecordedEdit& edit);
// Throws DamagedBytes.
RecordedEdit DecodeEdit(std::string_view bytes);

}  // namespace palpate
