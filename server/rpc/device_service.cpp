#include "server/rpc/device_service.h"

#include "common/wire/convert.h"

namespace palpate {
namespace {

v1::VerificationLevel ToProto(VerificationLevel level) {
  switch (level) {
    case VerificationLevel::kNone:
      return v1::VERIFICATION_LEVEL_NONE;
    case VerificationLevel::kEnumerated:
      return v1::VERIFICATION_LEVEL_ENUMERATED;
    case VerificationLevel::kIdentified:
      return v1::VERIFICATION_LEVEL_IDENTIFIED;
    case VerificationLevel::kStateRead:
      return v1::VERIFICATION_LEVEL_STATE_READ;
    case VerificationLevel::kForceVerified:
      return v1::VERIFICATION_LEVEL_FORCE_VERIFIED;
    case VerificationLevel::kSimulated:
      return v1::VERIFICATION_LEVEL_SIMULATED;
  }
  return v1::VERIFICATION_LEVEL_UNSPECIFIED;
}

v1::DeviceDescription ToProto(const DeviceSpec& spec) {
  v1::DeviceDescription out;
  out.set_kind(spec.kind);
  out.set_model(spec.model);
  *out.mutable_workspace_min_mm() = palpate::ToProto(spec.workspace_min_mm);
  *out.mutable_workspace_max_mm() = palpate::ToProto(spec.workspace_max_mm);
  out.set_max_force_n(spec.max_force_n);
  out.set_continuous_force_n(spec.continuous_force_n);
  out.set_position_resolution_mm(spec.position_resolution_mm);
  out.set_button_count(static_cast<std::uint32_t>(spec.button_count));
  out.set_verification_level(ToProto(spec.verification_level));
  return out;
}

}  // namespace

grpc::Status DeviceService::GetDevice(grpc::ServerContext*, const v1::GetDeviceRequest*,
                                      v1::GetDeviceResponse* response) {
  *response->mutable_device() = ToProto(spec_);
  v1::ServoDescription* servo = response->mutable_servo();
  servo->set_rate_hz(ServoLoop::kRateHz);
  servo->set_realtime_scheduling(servo_.grant().fifo);
  servo->set_memory_locked(servo_.grant().memory_locked);
  for (const std::string& warning : servo_.grant().warnings) servo->add_warnings(warning);
  servo->set_ticks(servo_.ticks());
  servo->set_missed_ticks(servo_.missed_ticks());
  servo->set_scenes_applied(inbox_.announced());
  servo->set_version(PALPATE_VERSION);
  servo->set_faulty_ticks(servo_.faulty_ticks());
  servo->set_page_faults(servo_.page_faults());
  servo->set_lost_samples(servo_.lost_samples());
  return grpc::Status::OK;
}

}  // namespace palpate
