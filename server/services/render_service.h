// The services of what is felt, how and where: RenderService, RegistrationService, SeriesService.
// They translate between messages, the session and the player of series.
#pragma once

#include "palpate/v1/registration.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/series.grpc.pb.h"
#include "server/client_paths/path_policy.h"
#include "server/metrics/service_metrics.h"
#include "server/services/calls.h"
#include "server/session/series/series_player.h"
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

class SeriesService final : public v1::SeriesService::CallbackService {
 public:
  // Borrows all arguments.
  SeriesService(Calls& calls, Session& session, SeriesPlayer& player, const PathPolicy& paths)
      : calls_(calls), session_(session), player_(player), paths_(paths) {}

  EventStream<v1::LoadSeriesResponse>* LoadSeries(CallContext* context,
                                                  const v1::LoadSeriesRequest* request) override;
  Reply* GetSeries(CallContext* context, const v1::GetSeriesRequest* request,
                   v1::GetSeriesResponse* response) override;
  Reply* ControlSeries(CallContext* context, const v1::ControlSeriesRequest* request,
                       v1::ControlSeriesResponse* response) override;

 private:
  Calls& calls_;
  Session& session_;
  SeriesPlayer& player_;
  const PathPolicy& paths_;
};

}  // namespace palpate
