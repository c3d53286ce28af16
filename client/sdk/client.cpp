#include "client/sdk/client.h"

#include <exception>
#include <functional>
#include <utility>

#include "client/sdk/followers.h"
#include "client/sdk/link.h"
#include "client/sdk/messages.h"
#include "client/sdk/server_choice.h"
#include "palpate/v1/render.grpc.pb.h"

namespace palpate::client {
namespace {

// An exception of a callback ends the program. Without this, the threads would take a callback's
// Error for the loss of a connection. While the client ends, the callback's own calls fail. That is
// no fault of the program.
template <typename... Arguments>
std::function<void(Arguments...)> EndingIfItThrows(std::function<void(Arguments...)> callback,
                                                   const Monitor& monitor) {
  if (!callback) return callback;
  return [callback = std::move(callback), &monitor](Arguments... arguments) noexcept {
    try {
      callback(arguments...);
    } catch (const Error&) {
      if (!monitor.stopping()) std::terminate();
    }
  };
}

}  // namespace

class Client::Parts {
 public:
  Parts(Link& link_of_calls, ClientOptions options)
      : link(link_of_calls),
        facts(link, monitor,
              {.settings = EndingIfItThrows(std::move(options.callbacks.on_settings), monitor),
               .facts = EndingIfItThrows(std::move(options.callbacks.on_facts), monitor)}),
        poses(link, monitor, options.poses, Events(options.callbacks)) {
    if (options.follow_volume) {
      volume.emplace(link, monitor,
                     EndingIfItThrows(std::move(options.callbacks.on_volume), monitor));
    }
  }
  ~Parts() { Join(); }

  void End() {
    monitor.Stop();
    link.CancelCalls();
  }

  // Until the last callback has returned, callbacks may use all of this.
  void Join() {
    End();
    poses.End();
    if (volume) volume->End();
    facts.End();
  }

  // Called last, when all members that the threads use exist.
  void Begin() {
    facts.Begin();
    if (volume) volume->Begin();
    poses.Begin();
  }

  Link& link;
  Monitor monitor;
  FactsFollower facts;
  std::optional<VolumeFollower> volume;
  PoseFollower poses;

 private:
  PoseFollower::Events Events(Callbacks& callbacks) {
    return {.connection = EndingIfItThrows(std::move(callbacks.on_connection), monitor),
            .poses = EndingIfItThrows(std::move(callbacks.on_poses), monitor),
            .first_settings = [this](const v1::GetSettingsResponse& response) {
              facts.Replace(FromProto(response.settings(), response.settings_revision(),
                                      response.ball(), response.replayed()));
            }};
  }
};

Client::Client(ClientOptions options)
    : Calls(Resolve({options.profile, options.address, options.credentials})),
      parts_(std::make_unique<Parts>(link(), std::move(options))) {
  parts_->Begin();
}

Client::~Client() { parts_->Join(); }

void Client::Disconnect() {
  parts_->End();
  parts_->poses.End();
  parts_->link.Renew();
  parts_->monitor.Set({ConnectionState::kLost, "disconnected"});
}

Connection Client::connection() const { return parts_->monitor.connection(); }

bool Client::WaitUntilConnected(std::chrono::milliseconds timeout) const {
  return parts_->monitor.WaitUntilConnected(timeout) != 0;
}

std::optional<Pose> Client::NewestPose() const { return parts_->poses.Newest(); }
std::uint64_t Client::dropped_poses() const { return parts_->poses.dropped(); }
void Client::SetPoseRate(const PoseRate& rate) { parts_->poses.SetRate(rate); }

std::optional<Settings> Client::NewestSettings() const { return parts_->facts.NewestSettings(); }
std::shared_ptr<const Facts> Client::NewestFacts() const { return parts_->facts.Newest(); }

Settings Client::GetSettings() {
  const std::uint64_t epoch = parts_->monitor.epoch();
  const Settings settings = Calls::GetSettings();
  parts_->facts.Take(settings, epoch);
  return settings;
}

SettingsResult Client::Set(const SettingsUpdate& update) {
  const std::uint64_t epoch = parts_->monitor.epoch();
  const SettingsResult result = Calls::Set(update);
  parts_->facts.Take(result.settings, epoch);
  return result;
}

std::optional<VolumeUpdate> Client::TakeVolumeUpdate() {
  return parts_->volume ? parts_->volume->Take() : std::nullopt;
}
VolumeStatus Client::volume_status() const {
  return parts_->volume ? parts_->volume->status() : VolumeStatus();
}

}  // namespace palpate::client
