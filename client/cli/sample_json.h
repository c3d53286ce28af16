// One tick as a JSON object. Pure; any thread.
#pragma once

#include <string>

#include "client/cli/description.h"
#include "palpate/v1/pose.pb.h"

namespace palpate::cli {

// Keys are those of PoseSample; vectors are [x, y, z], the quaternion is
// [w, x, y, z], what is absent is null, `mode` is ModeName. Numbers keep their
// full precision.
Json ToJson(const v1::PoseSample& sample);

// "free", "constrained", "ejecting", "fault", "suspended".
std::string ModeName(v1::ProxyMode mode);

}  // namespace palpate::cli
