// FactsService: sends the newest of each fact to whoever follows (fact_board.h).
#pragma once

#include "palpate/v1/facts.grpc.pb.h"
#include "server/door/access.h"
#include "server/recording/recording_control.h"
#include "server/services/calls.h"
#include "server/services/device_service.h"
#include "server/services/fact_board.h"
#include "server/session/series/series_player.h"
#include "server/session/session.h"

namespace palpate {

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
