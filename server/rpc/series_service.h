// SeriesService: translates between messages and the player of series.
#pragma once

#include "palpate/v1/series.grpc.pb.h"
#include "server/rpc/access.h"
#include "server/session/path_policy.h"
#include "server/session/series_player.h"
#include "server/session/session.h"

namespace palpate {

class SeriesService final : public v1::SeriesService::Service {
 public:
  // Borrows all arguments.
  SeriesService(Access& access, Session& session, SeriesPlayer& player, const PathPolicy& paths)
      : access_(access), session_(session), player_(player), paths_(paths) {}

  grpc::Status LoadSeries(grpc::ServerContext* context, const v1::LoadSeriesRequest* request,
                          grpc::ServerWriter<v1::LoadSeriesResponse>* writer) override;
  grpc::Status GetSeries(grpc::ServerContext* context, const v1::GetSeriesRequest* request,
                         v1::GetSeriesResponse* response) override;
  grpc::Status ControlSeries(grpc::ServerContext* context, const v1::ControlSeriesRequest* request,
                             v1::ControlSeriesResponse* response) override;

 private:
  Access& access_;
  Session& session_;
  SeriesPlayer& player_;
  const PathPolicy& paths_;
};

}  // namespace palpate
