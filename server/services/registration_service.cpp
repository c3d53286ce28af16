#include "server/services/registration_service.h"

#include "common/contract/registration.h"
#include "common/wire/status.h"
#include "common/wire/values.h"

namespace palpate {
namespace {

Registration RegistrationOf(const VolumeState& state) {
  const VolumePlace& place = state.registration;
  return {place.p_DCenter_mm, UnalignedQuaternion(place.R_DW), place.device_mm_per_volume_mm,
          DeviceMmPerVoxel(place, state.volume->metadata())};
}

}  // namespace

Reply* RegistrationService::GetRegistration(CallContext* context,
                                            const v1::GetRegistrationRequest* request,
                                            v1::GetRegistrationResponse* response) {
  return calls_.Answer(context, "/palpate.v1.RegistrationService/GetRegistration", *request,
                       *response, [=, this](const Admission&) {
                         const VolumeState state = session_.shown().volume();
                         *response->mutable_registration() = ToProto(RegistrationOf(state));
                         response->set_settings_revision(state.settings_revision);
                         response->set_replayed(state.replayed);
                       });
}

Reply* RegistrationService::UpdateRegistration(CallContext* context,
                                               const v1::UpdateRegistrationRequest* request,
                                               v1::UpdateRegistrationResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.RegistrationService/UpdateRegistration", *request, *response,
      [=, this](const Admission& by) {
        const UpdateRegistrationRequest update = FromProto(*request);
        const auto change = [&](const VolumeState& state) {
          return Apply(update, state.volume->metadata(), session_.device(), state.registration);
        };
        const VolumeState state = session_.Move(change, update.expected_revision, update.facing);
        by.Changed("placement");
        const AppliedTick applied = session_.WaitForServo(state.scene_revision);
        *response->mutable_registration() = ToProto(RegistrationOf(state));
        response->set_settings_revision(state.settings_revision);
        response->set_applied_tick(applied.tick);
        response->set_not_kept(state.move_problem.empty() ? session_.AwaitPlaceKept()
                                                          : state.move_problem);
      });
}

}  // namespace palpate
