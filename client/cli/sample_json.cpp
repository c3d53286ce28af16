#include "client/cli/sample_json.h"

#include "client/cli/device_description.h"
#include "client/sdk/words.h"

namespace palpate::cli {

Json ToJson(const client::Pose& pose) {
  const auto vector = [](const std::optional<Vec3>& value) {
    return value ? ToJson(*value) : Json();
  };
  // An older daemon does not send the state of the forces.
  const bool is_told = pose.forces.state != client::ForceState::kUnknown;
  const client::UnalignedQuaternion& q = pose.stylus_orientation;
  return {{"tick", pose.tick},
          {"time_ns", pose.time_ns},
          {"hip_mm", ToJson(pose.hip_mm)},
          {"scp_h_mm", ToJson(pose.scp_h_mm)},
          {"scp_h_normal", vector(pose.scp_h_normal)},
          {"scp_v_mm", vector(pose.scp_v_mm)},
          {"scp_v_normal", vector(pose.scp_v_normal)},
          {"stylus_orientation", {q.w(), q.x(), q.y(), q.z()}},
          {"buttons", pose.buttons},
          {"force_n", ToJson(pose.force_n)},
          {"forces", is_told ? ToJson(pose.forces) : Json()},
          {"mode", NameOf(pose.mode)},
          {"contact", pose.contact},
          {"density", pose.density},
          {"isovalue", pose.isovalue},
          {"free_side", NameOf(pose.free_side)},
          {"settings_revision", pose.settings_revision},
          {"volume_revision", pose.volume_revision},
          {"update_ns", pose.update_ns},
          {"missed_ticks", pose.missed_ticks},
          {"iterations", pose.iterations},
          {"capped_ticks", pose.capped_ticks},
          {"replayed", pose.replayed}};
}

}  // namespace palpate::cli
