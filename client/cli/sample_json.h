// One tick as a JSON object. Pure; any thread.
#pragma once

#include "client/cli/description.h"
#include "client/sdk/pose.h"

namespace palpate::cli {

// Keys are those of PoseSample; vectors are [x, y, z], the quaternion is
// [w, x, y, z], what is absent is null, `mode` is its word. Numbers keep their
// full precision.
Json ToJson(const client::Pose& pose);

}  // namespace palpate::cli
