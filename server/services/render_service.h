// RenderService: translates between messages and the session.
#pragma once

#include "palpate/v1/render.grpc.pb.h"
#include "server/metrics/service_metrics.h"
#include "server/services/calls.h"
#include "server/session/session.h"

namespace palpate {

class RenderService final : public v1::RenderService::CallbackService {
 public:
  RenderService(Calls& calls, Session& session, ServiceMetrics& metrics)
      : calls_(calls), session_(session), metrics_(metrics) {}

  Reply* GetSettings(CallContext* context, const v1::GetSettingsRequest* request,
                     v1::GetSettingsResponse* response) override;
  Reply* UpdateSettings(CallContext* context, const v1::UpdateSettingsRequest* request,
                        v1::UpdateSettingsResponse* response) override;

 private:
  Calls& calls_;
  Session& session_;
  ServiceMetrics& metrics_;
};

// Throws Error (kInvalidArgument) for a mask that names unknown fields, and for named fields
// without a value. The session checks the ranges.
SettingsUpdate FromProto(const v1::RenderSettings& settings,
                         const google::protobuf::FieldMask& update_mask);
// Also throws for an empty mask.
SettingsUpdate FromProto(const v1::UpdateSettingsRequest& request);

}  // namespace palpate
