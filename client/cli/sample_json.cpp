#include "client/cli/sample_json.h"

#include "client/cli/device_description.h"

namespace palpate::cli {

Json ToJson(const v1::PoseSample& sample) {
  const auto vector = [](bool present, const v1::Vector3& value) {
    return present ? ToJson(value) : Json();
  };
  Json json;
  json["tick"] = sample.tick();
  json["time_ns"] = sample.time_ns();
  json["hip_mm"] = vector(sample.has_hip_mm(), sample.hip_mm());
  json["scp_h_mm"] = vector(sample.has_scp_h_mm(), sample.scp_h_mm());
  json["scp_h_normal"] = vector(sample.has_scp_h_normal(), sample.scp_h_normal());
  json["scp_v_mm"] = vector(sample.has_scp_v_mm(), sample.scp_v_mm());
  json["scp_v_normal"] = vector(sample.has_scp_v_normal(), sample.scp_v_normal());
  json["stylus_orientation"] = nullptr;
  if (sample.has_stylus_orientation()) {
    const v1::Quaternion& q = sample.stylus_orientation();
    json["stylus_orientation"] = {q.w(), q.x(), q.y(), q.z()};
  }
  json["buttons"] = sample.buttons();
  json["force_n"] = vector(sample.has_force_n(), sample.force_n());
  json["forces"] = sample.has_forces() ? ToJson(sample.forces()) : Json();
  json["mode"] = ModeName(sample.mode());
  json["contact"] = sample.contact();
  json["density"] = sample.density();
  json["isovalue"] = sample.isovalue();
  json["free_side"] = sample.free_side() == v1::FREE_SIDE_ABOVE ? "above" : "below";
  json["settings_revision"] = sample.settings_revision();
  json["volume_revision"] = sample.volume_revision();
  json["update_ns"] = sample.update_ns();
  json["missed_ticks"] = sample.missed_ticks();
  json["iterations"] = sample.iterations();
  json["capped_ticks"] = sample.capped_ticks();
  return json;
}

std::string ModeName(v1::ProxyMode mode) {
  switch (mode) {
    case v1::PROXY_MODE_FREE:
      return "free";
    case v1::PROXY_MODE_CONSTRAINED:
      return "constrained";
    case v1::PROXY_MODE_EJECTING:
      return "ejecting";
    case v1::PROXY_MODE_FAULT:
      return "fault";
    case v1::PROXY_MODE_SUSPENDED:
      return "suspended";
    default:
      return "unspecified";
  }
}

}  // namespace palpate::cli
