// The result of an edit as text and as JSON, and the values of a block.
//
// Threads: main only, except DescribeEdit, which is pure.
#pragma once

#include <string>
#include <vector>

#include "client/sdk/edit.h"

namespace palpate::cli {

void PrintEdit(const client::EditResult& result, bool json);

// Returns text such as "515 voxels changed within 15 15 15 to 25 25 25, applied at tick 123, volume
// revision 7; 1 to undo, 0 to redo". Pure.
std::string DescribeEdit(const client::EditResult& result);

// Reads the values of a block: raw float32, little-endian, from `file`, or from stdin for "-".
// Errors: kNotFound, kTooLarge (more than a block may have), kInvalidArgument (not a whole number
// of values).
std::vector<float> ReadBlockValues(const std::string& file);

}  // namespace palpate::cli
