// A time series under the stylus. series.proto explains the fields.
//
// Threads: plain values.
#pragma once

#include "common/contract/series.h"

namespace palpate::client {

using palpate::SeriesState;

// Absent fields change nothing.
using SeriesControl = ControlSeriesRequest;
using SeriesControlled = ControlSeriesResponse;
using SeriesResult = LoadSeriesResult;

}  // namespace palpate::client
