#include "server/rpc/registration_service.h"

#include "common/wire/convert.h"
#include "common/wire/status.h"

namespace palpate {
namespace {

v1::Registration RegistrationOf(const VolumeState& state) {
  const Registration& registration = state.registration;
  v1::Registration out;
  *out.mutable_center_mm() = palpate::ToProto(registration.p_DCenter_mm);
  *out.mutable_rotation() = palpate::ToProto(registration.R_DW);
  out.set_device_mm_per_volume_mm(registration.device_mm_per_volume_mm);
  out.set_device_mm_per_voxel(DeviceMmPerVoxel(registration, state.volume->metadata()));
  return out;
}

RegistrationUpdate UpdateOf(const v1::UpdateRegistrationRequest& request) {
  RegistrationUpdate update;
  update.reset = request.reset();
  if (request.has_center_mm()) update.p_DCenter_mm = FromProto(request.center_mm());
  if (request.has_rotation()) update.R_DW = FromProto(request.rotation());
  if (request.has_device_mm_per_volume_mm()) {
    update.device_mm_per_volume_mm = request.device_mm_per_volume_mm();
  }
  if (request.has_device_mm_per_voxel()) update.device_mm_per_voxel = request.device_mm_per_voxel();
  if (request.has_translate_mm()) {
    update.translate_D_mm = FromProto(request.translate_mm());
  }
  if (request.has_rotate()) update.rotate_D = FromProto(request.rotate());
  if (request.has_scale_by()) update.scale_by = request.scale_by();
  return update;
}

}  // namespace

Reply* RegistrationService::GetRegistration(CallContext* context,
                                            const v1::GetRegistrationRequest* request,
                                            v1::GetRegistrationResponse* response) {
  return calls_.Answer(context, "/palpate.v1.RegistrationService/GetRegistration", *request,
                       *response, [=, this](const Admission&) {
                         const VolumeState state = session_.volume();
                         *response->mutable_registration() = RegistrationOf(state);
                         response->set_settings_revision(state.settings_revision);
                       });
}

Reply* RegistrationService::UpdateRegistration(CallContext* context,
                                               const v1::UpdateRegistrationRequest* request,
                                               v1::UpdateRegistrationResponse* response) {
  return calls_.Answer(context, "/palpate.v1.RegistrationService/UpdateRegistration", *request,
                       *response, [=, this](const Admission& by) {
                         const RegistrationUpdate update = UpdateOf(*request);
                         const auto change = [&](const VolumeState& state) {
                           return Apply(update, state.volume->metadata(), session_.device(),
                                        state.registration);
                         };
                         std::optional<std::uint64_t> expected;
                         if (request->has_expected_revision())
                           expected = request->expected_revision();
                         std::optional<PatientFacing> facing;
                         if (request->has_facing()) {
                           facing = {request->facing().face(), request->facing().head()};
                           if (request->facing().has_loaded_revision())
                             facing->loaded_revision = request->facing().loaded_revision();
                         }
                         const VolumeState state = session_.Move(change, expected, true, facing);
                         by.Changed("placement");
                         const AppliedTick applied = session_.WaitForServo(state.scene_revision);
                         *response->mutable_registration() = RegistrationOf(state);
                         response->set_settings_revision(state.settings_revision);
                         response->set_applied_tick(applied.tick);
                       });
}

}  // namespace palpate
