// One tick as a JSON object. Pure; any thread.
#pragma once

#include "client/cli/description.h"
#include "client/sdk/pose.h"

namespace palpate::cli {

// Keys are those of PoseSample. Vectors are [x, y, z], the quaternion is [w, x, y, z], an absent
// value is null, and `mode` is a word. Numbers keep their full precision.
Json ToJson(const client::Pose& pose);

}  // namespace palpate::cli
