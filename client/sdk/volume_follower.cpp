#include "client/sdk/volume_follower.h"

#include <utility>

namespace palpate::client {
namespace {

using namespace std::chrono_literals;

constexpr auto kVolumePoll = 50ms;  // how often to look for the end
// After errors that an immediate retry does not mend: a volume that is too large, a daemon of
// another version.
constexpr auto kPauseAfterRefusal = 5000ms;

}  // namespace

VolumeFollower::VolumeFollower(Link& link, Monitor& monitor, std::function<void()> on_volume)
    : link_(link), monitor_(monitor), on_volume_(std::move(on_volume)) {}

void VolumeFollower::Begin() {
  thread_ = std::thread([this] { Run(); });
}

void VolumeFollower::End() {
  if (thread_.joinable()) thread_.join();
}

VolumeStatus VolumeFollower::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

void VolumeFollower::Run() {
  while (!monitor_.stopping()) {
    const std::uint64_t epoch = monitor_.WaitUntilConnected(1000ms);
    if (epoch == 0) continue;
    try {
      Follow(epoch);
    } catch (const Error& error) {
      mirror_.Reset();
      Say(nullptr, error.what());
      if (copy_.Merge(mirror_) && on_volume_) on_volume_();
      monitor_.Pause(kPauseAfterRefusal);
    }
  }
}

// Each connection has its own reader: an old reader would first wait out its pause. The mirror
// stays, with the revision to resume from.
void VolumeFollower::Follow(std::uint64_t epoch) {
  VolumeReader reader(link_.volume_channel(), mirror_);
  std::string problem;
  while (!monitor_.stopping() && monitor_.IsConnected(epoch)) {
    switch (reader.Next(kVolumePoll)) {
      case VolumeReader::Event::kTimeout:
        continue;
      case VolumeReader::Event::kLost:
        problem = reader.last_loss()->what();
        break;
      case VolumeReader::Event::kApplied:
      case VolumeReader::Event::kComplete:
        problem.clear();
        break;
    }
    Say(&reader, problem);
    if (copy_.Merge(mirror_) && on_volume_) on_volume_();
  }
  bytes_before_ += reader.bytes_received();
}

void VolumeFollower::Say(const VolumeReader* reader, const std::string& problem) {
  const std::lock_guard lock(mutex_);
  status_.complete = mirror_.is_complete();
  status_.bricks_left = mirror_.bricks_left();
  status_.bytes_received = bytes_before_ + (reader ? reader->bytes_received() : 0);
  status_.problem = problem;
  status_.is_loading = !problem.empty() && reader && reader->is_loading();
}

}  // namespace palpate::client
