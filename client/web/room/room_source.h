// A room of a NATS server as the source of what guests see.
//
// What the room's publisher sends goes on to guests as it is. Blobs are checked against their
// names, and a manifest is told to guests when every blob that it names is here.
//
// Threads: methods on the network thread, unless stated; none waits for NATS. `post` runs a
// function on the network thread; none runs before the constructor has returned. The source must
// live until no posted function runs any more. Ownership: borrows the hub.
// Errors: those of Check(NatsServer). A server that is away is no error.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/hub/hub.h"
#include "client/web/room/nats_link.h"
#include "client/web/room/room_copy.h"
#include "client/web/room/room_protocol.h"
#include "client/web/room/room_state.h"
#include "client/web/upstream/source.h"
#include "client/web/upstream/stopper.h"
#include "client/web/upstream/worker.h"

namespace palpate::web {

class RoomSource final : public Source {
 public:
  RoomSource(RoomOptions options, Hub& hub, Post post);
  ~RoomSource() override = default;
  RoomSource(const RoomSource&) = delete;
  RoomSource& operator=(const RoomSource&) = delete;

  void Poll() override;
  BlobPtr FindBlob(std::string_view name) const override { return copy_.Find(name); }
  // While the publisher takes a change, a user's newest change of a key replaces the same user's
  // one that waits; that is done then.
  void Steer(const SteerRequest& request, std::function<void(std::string error)> done) override;
  bool MayStop() const override { return !options_.server.user.empty(); }
  std::string Health() const override { return connection_.why; }
  bool is_copy_complete() const override { return is_complete_ && kept_->is_connected(); }

  // To NATS, for poses and for voxels. Any thread.
  bool is_connected() const { return live_->is_connected() && kept_->is_connected(); }

 private:
  // What came since the network thread looked: the newest of each.
  struct News {
    std::optional<std::string> pose;
    std::optional<Beat> beat;
    std::optional<RoomCopy::Shown> shown;
    std::optional<std::size_t> missing_groups;
    std::array<std::optional<std::string>, kTopics> texts;
  };
  using TakeIntoCopy = RoomCopy::News (RoomCopy::*)(std::string_view, std::string_view,
                                                    RoomCopy::Time);

  void Listen();
  void HearBeat(const Beat& beat);
  void TakeKept(TakeIntoCopy take, std::string_view subject, std::string_view bytes);
  void AskAnew(bool everything);
  void Ask();
  void Note(const std::function<void(News&)>& note);
  void Take();
  void PutShown(RoomCopy::Shown shown);
  void PutCopy();
  void PutPose(std::string sent);
  void PutConnection();
  void Log(const std::string& line);
  std::string AskPublisher(const SteerRequest& request);

  const RoomOptions options_;
  Hub& hub_;
  const Post post_;
  const Subjects subjects_;

  // The network thread's.
  RoomState state_;
  RoomState::Connection connection_;
  std::int64_t connection_since_ms_ = 0;
  std::string pose_;                        // the newest, as the publisher sent it
  std::array<std::string, kTopics> doing_;  // what the publisher told of series and recording
  std::uint64_t missing_groups_ = 0;
  std::string last_line_, logged_state_;

  std::atomic<bool> is_complete_{false};
  std::atomic<bool> is_answered_{false};  // since Poll looked

  std::mutex news_mutex_;
  News news_;
  bool is_take_posted_ = false;

  std::mutex copy_mutex_;  // never the network thread's: blobs are unpacked under it
  RoomCopy copy_;          // Find needs no mutex

  std::string inbox_;  // begins the subjects of answers
  std::unique_ptr<NatsLink> kept_;
  std::unique_ptr<NatsLink> live_;           // ends first: a beat asks by kept_
  std::unique_ptr<Worker> asker_, steerer_;  // end before the links, which they use
  std::unique_ptr<Stopper> stopper_;         // as they do
};

}  // namespace palpate::web
