// FactsService and ActivityService: send what is true of the daemon now (fact_board.h), and who
// changed what.
#pragma once

#include "palpate/v1/activity.grpc.pb.h"
#include "palpate/v1/facts.grpc.pb.h"
#include "server/door/access.h"
#include "server/recording/recording_control.h"
#include "server/services/calls.h"
#include "server/services/device_service.h"
#include "server/services/fact_board.h"
#include "server/session/series/series_player.h"
#include "server/session/session.h"

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
  Reply* EndCaller(CallContext* context, const v1::EndCallerRequest* request,
                   v1::EndCallerResponse* response) override;

 private:
  Calls& calls_;
};

class FactsService final : public v1::FactsService::CallbackService, public SceneListener {
 public:
  // Borrows all. Construct it before the session's first load, and before any call is answered.
  FactsService(Access& access, Session& session, const SeriesPlayer& series,
               const RecordingControl& recording, const DeviceService& device);
  ~FactsService() override { Stop(); }

  grpc::ServerBidiReactor<v1::FollowRequest, v1::FollowResponse>* Follow(
      CallContext* context) override;
  void OnScene(const Scene&, std::span<const BrickChange>) override;
  // The scene that viewers are shown may be another one.
  void SceneMayHaveChanged();

  // Ends every stream.
  void Stop() noexcept { board_.Stop(); }

 private:
  Access& access_;
  FactBoard board_;
  const Listening listening_;
};

}  // namespace palpate
