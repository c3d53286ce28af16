// SeriesService: translates between messages and the player of series.
#pragma once

#include "palpate/v1/series.grpc.pb.h"
#include "server/client_paths/path_policy.h"
#include "server/services/calls.h"
#include "server/session/series/series_player.h"
#include "server/session/session.h"

namespace palpate {

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
