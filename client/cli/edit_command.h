// `palpate edit`, `undo`, `redo`, `revert` and `save`.
//
// Threads: main only. Errors: as Connection::Call and WriteOutput; kConflict where
// the revision is another, or there is nothing to take back.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "palpate/v1/edit.pb.h"
#include "palpate/v1/volume.pb.h"

namespace palpate::cli {

class Connection;

// Each makes the change and prints what it did.
void EditVolume(const Connection& connection, const v1::EditVolumeRequest& request, bool json);

// Shows progress on stderr. Ctrl-C and SIGTERM cancel (kCancelled).
void FilterVolume(const Connection& connection, const v1::FilterVolumeRequest& request, bool json);

enum class HistoryCommand { kUndo, kRedo, kRevert };
void MoveInHistory(const Connection& connection, HistoryCommand command,
                   const std::optional<std::uint64_t>& expected_revision, bool json);

// Shows progress on stderr. Ctrl-C and SIGTERM cancel (kCancelled).
void SaveVolume(const Connection& connection, v1::SaveVolumeRequest request, bool json);

// The values of a dense block: raw bytes of `file`, or of stdin for "-".
// Errors: kNotFound; kTooLarge for more than a block may have.
std::string ReadBlockValues(const std::string& file);

// Such as "515 voxels changed within 15 15 15 to 25 25 25, applied at tick 123,
// volume revision 7; 1 to undo, 0 to redo". Pure.
std::string DescribeEdit(const v1::EditVolumeResponse& response);

}  // namespace palpate::cli
