#include "client/sdk/settings_follower.h"

#include <utility>

#include "client/sdk/setting_messages.h"

namespace palpate::client {
namespace {

constexpr std::chrono::milliseconds kPauseAfterFailure{100};

}  // namespace

SettingsFollower::SettingsFollower(Link& link, Monitor& monitor,
                                   std::function<void(const Settings&)> on_settings)
    : link_(link), monitor_(monitor), on_settings_(std::move(on_settings)) {}

void SettingsFollower::Begin() {
  thread_ = std::thread([this] { Run(); });
}

void SettingsFollower::End() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

std::optional<Settings> SettingsFollower::Newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

void SettingsFollower::Replace(const Settings& settings) {
  {
    const std::lock_guard lock(mutex_);
    newest_ = settings;
    is_new_ = true;
    asked_ = false;
  }
  wake_.notify_all();
}

void SettingsFollower::Take(const Settings& settings, std::uint64_t epoch) {
  {
    const std::lock_guard lock(mutex_);
    // An answer of an earlier daemon may have a higher revision.
    if (!monitor_.IsConnected(epoch)) return;
    if (newest_ && newest_->revision >= settings.revision) return;
    newest_ = settings;
    is_new_ = true;
  }
  wake_.notify_all();
}

void SettingsFollower::Ask() {
  {
    const std::lock_guard lock(mutex_);
    asked_ = true;
  }
  wake_.notify_all();
}

void SettingsFollower::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return ending_ || asked_ || is_new_; });
    if (ending_) return;
    if (std::exchange(is_new_, false)) {
      const Settings settings = *newest_;
      lock.unlock();
      if (on_settings_) on_settings_(settings);
    } else {
      asked_ = false;
      lock.unlock();
      Fetch();
    }
    lock.lock();
  }
}

void SettingsFollower::Fetch() {
  const std::uint64_t epoch = monitor_.epoch();
  try {
    const v1::GetSettingsResponse response = link_.Call<v1::RenderService>(
        &v1::RenderService::Stub::GetSettings, v1::GetSettingsRequest());
    Take(FromProto(response.settings(), response.settings_revision()), epoch);
  } catch (const Error&) {
    // If the daemon is not reached, the pose thread notices the loss soon. After the reconnection
    // it asks for the settings again.
    monitor_.Pause(kPauseAfterFailure);
    if (monitor_.IsConnected(epoch)) Ask();
  }
}

}  // namespace palpate::client
