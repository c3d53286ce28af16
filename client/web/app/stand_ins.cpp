// Until client/web/nats has them: enough to parse the command line and to start.
#include "client/web/nats/nats_link.h"
#include "client/web/nats/room_publisher.h"
#include "client/web/nats/room_source.h"

namespace palpate::web {

void Check(const NatsServer&) {}

class KeptPublisher {};
class LivePublisher {};
RoomPublisher::RoomPublisher(RoomOptions, Hub&, Post) {}
RoomPublisher::~RoomPublisher() = default;
void RoomPublisher::OnTopic(Topic) {}
void RoomPublisher::OnPose() {}
bool RoomPublisher::is_connected() const { return false; }
std::string RoomPublisher::problem() const { return "NATS is not reached"; }

struct NatsLink::Session {};
NatsLink::~NatsLink() = default;
RoomSource::RoomSource(RoomOptions options, Hub& hub, Post post)
    : options_(std::move(options)),
      hub_(hub),
      post_(std::move(post)),
      subjects_(options_.room),
      state_(""),
      copy_(options_.room) {}
RoomSource::~RoomSource() = default;
void RoomSource::Poll() {}
void RoomSource::Steer(const SteerRequest&, std::function<void(std::string error)> done) {
  done("the room's publisher does not answer");
}
std::string RoomSource::Hello(const std::string&, const std::vector<std::string>&) const {
  return R"({"type":"hello"})";
}
std::optional<double> RoomSource::pose_age_s() const { return {}; }
bool RoomSource::is_copy_complete() const { return false; }

}  // namespace palpate::web
