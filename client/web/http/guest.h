// A guest's WebSocket: tells the newest of all topics and poses, and takes acknowledgements and
// changes of settings.
//
// At most one message is being written. What else is due is a set of topics, and the newest pose is
// read from the hub when it can be written: a slow guest skips values, and costs no memory. The
// number of guests comes with the next message, or at the next sweep.
//
// Lives as long as an operation on its socket is under way. Threads: the network thread.
#pragma once

#include <array>
#include <bitset>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "client/web/http/connections.h"
#include "client/web/http/peer_stream.h"
#include "client/web/http/routes.h"
#include "client/web/http/site.h"
#include "client/web/hub/hub.h"

namespace palpate::web {

inline constexpr std::size_t kMaxMessageBytes = 1024;

// What browsers send over /stream: JSON of at most kMaxMessageBytes.
struct Steer {
  std::uint64_t id = 0;  // comes back with the answer
  std::string key;
  double value = 0.0;
};

// What POST /login brings: one of the two.
struct LoginRequest {
  std::optional<std::string> room, token;
};
std::optional<LoginRequest> ParseLogin(std::string_view text);

// The poses that a guest has not acknowledged.
class PoseWindow {
 public:
  static constexpr std::size_t kMost = 32;

  bool IsFull() const { return count_ == kMost; }
  // Not if it is full.
  void Sent(std::uint32_t sequence);
  // Acknowledges this pose and those before. False: it was never sent.
  bool Acknowledge(std::uint32_t sequence);

 private:
  std::array<std::uint32_t, kMost> sent_{};
  std::size_t oldest_ = 0, count_ = 0;
  std::uint32_t newest_ = 0;
  bool has_sent_ = false;
};

class Guest final : public Subscriber, public std::enable_shared_from_this<Guest> {
 public:
  // Of one session, in several tabs: for one more, the oldest ends.
  static constexpr std::size_t kMostOfASession = 4;
  // Between two sweeps: more than a page sends in a second. Bounds the answers that wait, too.
  static constexpr int kMostMessages = 100;
  // The same for bytes: frames without content are no messages.
  static constexpr std::size_t kMostBytes = 64 << 10;

  Guest(std::shared_ptr<Site> site, PeerStream stream, std::unique_ptr<Connections::Ticket> ticket,
        SessionPtr session, std::string peer);
  Guest(const Guest&) = delete;
  Guest& operator=(const Guest&) = delete;

  static bool IsFull(const Site& site);
  // Whose seat a further guest may take in a full house. Null: nobody's.
  static Guest* WhoGivesWayTo(const Session& session, const Site& site);

  // `request`: asks for the WebSocket. Counts as a guest until the end of the connection.
  void Start(const Request& request);
  // Ends the connection if its time is over. Called at every sweep.
  void Check();
  // Bytes that wait for this guest, and are not the hub's newest.
  std::size_t held_bytes() const;

  void OnTopic(Topic topic) override;
  void OnPose() override;

 private:
  using ErrorCode = boost::beast::error_code;

  void MakeRoom();
  void OnJoined(ErrorCode error);
  void Read();
  void OnMessage(ErrorCode error);
  bool Obey(std::string_view text);
  void ObeySteer(const Steer& steer);
  void Answer(std::uint64_t id, const std::string& error);
  void Write();
  Body TakeNext(bool& is_text);
  void OnWritten(ErrorCode error);
  // Says goodbye, then ends.
  void Leave(std::string_view kind, const char* why);
  void Drop(const char* why);
  // Ends at once. `kind`: "" if the guest went.
  void End(std::string_view kind);

  const std::shared_ptr<Site> site_;
  boost::beast::websocket::stream<PeerStream, /*deflate=*/false> socket_;
  std::unique_ptr<Connections::Ticket> ticket_;
  const SessionPtr session_;
  const std::string peer_;
  boost::beast::flat_buffer incoming_{kMaxMessageBytes};

  enum class State { kJoining, kOpen, kLeaving, kEnded };
  State state_ = State::kJoining;
  std::string_view left_for_;  // why it leaves
  std::deque<Body> texts_;     // hello and answers
  std::bitset<kTopics> due_;
  bool pose_due_ = false;
  Body writing_;  // null: nothing
  PoseWindow window_;
  Time write_began_{};               // or when it began to leave
  std::optional<Time> window_full_;  // since when
  int messages_ = 0;                 // since the last sweep
};

}  // namespace palpate::web
