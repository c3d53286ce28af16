// What an edit did, in words and in JSON; and the values of a block.
//
// Threads: main only, but for DescribeEdit, which is pure.
#pragma once

#include <string>
#include <vector>

#include "client/sdk/edit.h"

namespace palpate::cli {

void PrintEdit(const client::EditResult& result, bool json);

// Such as "515 voxels changed within 15 15 15 to 25 25 25, applied at tick 123,
// volume revision 7; 1 to undo, 0 to redo". Pure.
std::string DescribeEdit(const client::EditResult& result);

// The values of a dense block: raw float32, little-endian, of `file`, or of stdin for "-".
// Errors: kNotFound; kTooLarge for more than a block may have; kInvalidArgument for a part of one.
std::vector<float> ReadBlockValues(const std::string& file);

}  // namespace palpate::cli
