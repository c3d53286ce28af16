// `palpate load`.
#pragma once

#include <string>

#include "common/error/error.h"
#include "palpate/v1/volume.pb.h"

namespace grpc {
class Status;
}

namespace palpate::cli {

class Connection;

// Replaces the volume; shows progress and warnings on stderr and the new volume on
// stdout. Ctrl-C and SIGTERM cancel.
// Errors: as Connection::ErrorOf and WriteOutput; kCancelled.
void LoadVolume(const Connection& connection, v1::LoadVolumeRequest request);

// What its import warned of, on stderr.
void PrintWarnings(const v1::VolumeDescription& volume);

// The Error to end with after a failed load of any kind; while an Interrupt exists.
Error ErrorOfLoad(const Connection& connection, const grpc::Status& status);

// As Connection::PathThere; "builtin:..." stays as it is.
std::string SourceThere(const Connection& connection, const std::string& source);

}  // namespace palpate::cli
