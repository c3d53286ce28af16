// `palpate series ...`.
#pragma once

#include <string>

#include "palpate/v1/series.pb.h"

namespace palpate::cli {

class Connection;

// Loads a series; shows progress on stderr, the volume and the series on stdout.
// Ctrl-C and SIGTERM cancel.
// Errors of all: as Connection::ErrorOf and WriteOutput; kConflict without a series.
void LoadSeries(const Connection& connection, v1::LoadSeriesRequest request);

// Changes how it plays, and prints how it plays now.
void ControlSeries(const Connection& connection, const v1::ControlSeriesRequest& request,
                   bool json);
void PrintSeries(const Connection& connection, bool json);

// A line such as "series    frame 2.5 of 0 to 8, playing at 10 frames/s, ...". Pure.
std::string Describe(const v1::SeriesState& series);

}  // namespace palpate::cli
