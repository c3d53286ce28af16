// RegistrationService: translates between messages and the session.
#pragma once

#include "palpate/v1/registration.grpc.pb.h"
#include "server/services/calls.h"
#include "server/session/session.h"

namespace palpate {

class RegistrationService final : public v1::RegistrationService::CallbackService {
 public:
  RegistrationService(Calls& calls, Session& session) : calls_(calls), session_(session) {}

  Reply* GetRegistration(CallContext* context, const v1::GetRegistrationRequest* request,
                         v1::GetRegistrationResponse* response) override;
  Reply* UpdateRegistration(CallContext* context, const v1::UpdateRegistrationRequest* request,
                            v1::UpdateRegistrationResponse* response) override;

 private:
  Calls& calls_;
  Session& session_;
};

}  // namespace palpate
