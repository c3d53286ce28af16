// See common/precompiled/precompiled.cmake. No source includes this.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "common/precompiled/wire.h"
