// RegistrationService: translates between messages and the session.
#pragma once

#include "palpate/v1/registration.grpc.pb.h"
#include "server/rpc/access.h"
#include "server/session/session.h"

namespace palpate {

class RegistrationService final : public v1::RegistrationService::Service {
 public:
  RegistrationService(Access& access, Session& session) : access_(access), session_(session) {}

  grpc::Status GetRegistration(grpc::ServerContext* context,
                               const v1::GetRegistrationRequest* request,
                               v1::GetRegistrationResponse* response) override;
  grpc::Status UpdateRegistration(grpc::ServerContext* context,
                                  const v1::UpdateRegistrationRequest* request,
                                  v1::UpdateRegistrationResponse* response) override;

 private:
  Access& access_;
  Session& session_;
};

}  // namespace palpate
