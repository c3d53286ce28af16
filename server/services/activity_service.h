// ActivityService: who uses the daemon, and who changed what.
#pragma once

#include "palpate/v1/activity.grpc.pb.h"
#include "server/services/calls.h"

namespace palpate {

// Of now, without is_you.
v1::GetActivityResponse ToProto(const Activity& activity);
// Sets is_you of whoever made the admitted call.
void MarkCaller(const Admission& you, v1::GetActivityResponse& activity);

class ActivityService final : public v1::ActivityService::CallbackService {
 public:
  // Borrows it.
  explicit ActivityService(Calls& calls) : calls_(calls) {}

  Reply* GetActivity(CallContext* context, const v1::GetActivityRequest* request,
                     v1::GetActivityResponse* response) override;

 private:
  Calls& calls_;
};

}  // namespace palpate
