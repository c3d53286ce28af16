// Converts edits between messages and the volume's editor.
//
// Pure; any thread.
#pragma once

#include "palpate/v1/edit.pb.h"
#include "server/session/edits/volume_editor.h"
#include "server/volume/edit/edit.h"
#include "server/volume/edit/filter.h"

namespace palpate {

// Throws Error: kInvalidArgument if the request has no shape, no operation or no position;
// kTooLarge for a block of too many bytes. The editor checks the numbers.
VolumeEdit FromProto(const v1::EditVolumeRequest& request);

// The same for a filter.
VolumeFilter FromProto(const v1::FilterVolumeRequest& request);

v1::EditVolumeResponse ToProto(const EditOutcome& outcome, const AppliedTick& applied);

}  // namespace palpate
