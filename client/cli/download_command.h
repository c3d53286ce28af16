// `palpate download`.
#pragma once

#include <string>

namespace palpate::cli {

class Connection;

struct DownloadOptions {
  std::string file;
  bool overwrite = false;
};

// Copies the volume into a file; shows progress on stderr and what was written on
// stdout. The file is whole or not there (or as it was).
// Errors: as VolumeReader, WriteNrrd and WriteOutput; kUnavailable when the
// connection is lost again and again, kCancelled.
void Download(const Connection& connection, const DownloadOptions& options);

}  // namespace palpate::cli
