// The isovalues that palpated suggests, and the histogram behind them, as text.
//
// Values in data units. Pure; any thread.
#pragma once

#include <string>
#include <string_view>

#include "client/sdk/volume.h"

namespace palpate::cli {

// Lines of `palpate info`: the histogram with a mark at `isovalue`, the suggestions and the peaks.
// "" for a daemon that sends none.
std::string DescribeIsovalues(const client::VolumeInfo& volume, double isovalue);

// "isovalue 300 HU (bone in CT)"
std::string DescribeIsovalue(const client::VolumeInfo& volume, double isovalue);

// Errors: kInvalidArgument, with the names that there are.
double SuggestedIsovalueOf(const client::VolumeInfo& volume, std::string_view name);

}  // namespace palpate::cli
