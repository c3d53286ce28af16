// PoseService: streams of ticks to any number of subscribers.
//
// Each stream is a reactor with at most one write in progress. The pump thread adds samples and may
// start a write. gRPC's threads finish writes and deliver acknowledgements. No thread blocks here.
// Ownership: the pump holds streams by weak_ptr. A stream holds itself until gRPC has finished with
// it.
#pragma once

#include "palpate/v1/pose.grpc.pb.h"
#include "server/door/access.h"
#include "server/metrics/service_metrics.h"
#include "server/pump/pump.h"

namespace palpate {

class PoseService final : public v1::PoseService::CallbackService {
 public:
  PoseService(Access& access, Pump& pump, ServiceMetrics& metrics)
      : access_(access), pump_(pump), metrics_(metrics) {}

  grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse>* StreamPoses(
      grpc::CallbackServerContext* context) override;

 private:
  Access& access_;
  Pump& pump_;
  ServiceMetrics& metrics_;
};

}  // namespace palpate
