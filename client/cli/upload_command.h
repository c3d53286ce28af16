// `palpate upload`.
#pragma once

#include <filesystem>

#include "palpate/v1/volume.pb.h"

namespace palpate::cli {

class Connection;

// Sends `file` and replaces the volume by it; shows progress on stderr and the new
// volume on stdout. Ctrl-C and SIGTERM cancel.
// Errors: as Connection::ErrorOf and WriteOutput; kNotFound, kPermissionDenied and
// kInvalidArgument for a file that cannot be sent; kCancelled.
void UploadVolume(const Connection& connection, const std::filesystem::path& file,
                  const v1::LoadVolumeRequest& options);

}  // namespace palpate::cli
