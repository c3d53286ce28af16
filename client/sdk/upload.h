// Sends a file of this machine to the daemon.
//
// Threads: one. Errors: kNotFound, kInvalidArgument (not a file), kPermissionDenied, kUnavailable
// (the file cannot be read to its end), and those of the call.
#pragma once

#include <filesystem>

#include "client/sdk/link.h"
#include "client/sdk/progress.h"
#include "client/sdk/volume.h"

namespace palpate::client {

LoadResult Upload(Link& link, const std::filesystem::path& file, const LoadOptions& options,
                  const ProgressFunction& progress);

}  // namespace palpate::client
