// RegistrationService: translates between the wire and the session.
#pragma once

#include "palpate/v1/registration.grpc.pb.h"
#include "server/session/session.h"

namespace palpate {

class RegistrationService final : public v1::RegistrationService::Service {
 public:
  explicit RegistrationService(Session& session) : session_(session) {}

  grpc::Status GetRegistration(grpc::ServerContext* context,
                               const v1::GetRegistrationRequest* request,
                               v1::GetRegistrationResponse* response) override;
  grpc::Status UpdateRegistration(grpc::ServerContext* context,
                                  const v1::UpdateRegistrationRequest* request,
                                  v1::UpdateRegistrationResponse* response) override;

 private:
  Session& session_;
};

}  // namespace palpate
