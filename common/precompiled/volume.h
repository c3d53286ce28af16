// What files that look into OpenVDB's grids parse most: see precompiled.cmake. No source
// includes this.
#pragma once

#include <openvdb/openvdb.h>

#include "common/precompiled/pure.h"
