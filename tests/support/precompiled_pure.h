// See common/precompiled/precompiled.cmake. No source includes this.
#pragma once

#include <gtest/gtest.h>

#include "common/precompiled/pure.h"
