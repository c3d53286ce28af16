// Messages about volumes that several services share. Pure; any thread.
#pragma once

#include "palpate/v1/volume.pb.h"
#include "server/session/session.h"

namespace palpate {

v1::VolumeDescription ToProto(const VolumeState& state);

// Converts the request; the source is not judged yet. Throws Error (kInvalidArgument) for an
// unknown type of voxels. The loader checks everything else.
LoadRequest FromProto(const v1::LoadVolumeRequest& request);
// The settings that come with a load; may be empty. Throws Error (kInvalidArgument).
SettingsUpdate SettingsOf(const v1::LoadVolumeRequest& request);

// Sets the fields that the results of all loads have, when the session is kept with the volume.
template <class Result>
void SetResult(Session& session, VolumeState state, const AppliedTick& applied, Result& result) {
  state.settings_problem = session.AwaitSettingsKept();
  state.place_problem = session.AwaitPlaceKept();  // the load may have set its scale
  *result.mutable_volume() = ToProto(state);
  result.set_applied_tick(applied.tick);
  result.set_settings_revision(state.settings_revision);
  result.set_isovalue(state.isovalue);
}

}  // namespace palpate
