#include "server/state/session_keeper.h"

#include <pthread.h>

#include <algorithm>
#include <system_error>
#include <tuple>
#include <utility>

#include "common/error/error.h"
#include "server/log/log.h"

namespace palpate {
namespace {

// For example run-palpate-palpated.sock.toml.
std::filesystem::path FileFor(const std::filesystem::path& folder,
                              const std::filesystem::path& socket) {
  if (folder.empty()) return {};
  std::string name = std::filesystem::absolute(socket).lexically_normal().string();
  std::replace(name.begin(), name.end(), '/', '-');
  return folder / "sessions" / (name.substr(1) + ".toml");
}

bool IsSame(const LoadRequest& a, const LoadRequest& b) {
  const auto members = [](const LoadRequest& r) {
    return std::tie(r.source, r.spacing_mm, r.device_mm_per_volume_mm, r.raw, r.frame, r.grid,
                    r.component);
  };
  return members(a) == members(b);
}

// Entries whose configured value has changed since the save take the configured value of now.
void TakeChanges(const SavedSession& saved, const LoadRequest& now,
                 const RenderSettings& settings_now, FeltSession& felt) {
  const LoadRequest& before = saved.configured;
  if (std::tie(now.isovalue, now.normalized_isovalue) ==
      std::tie(before.isovalue, before.normalized_isovalue)) {
    felt.volume.isovalue = felt.settings.isovalue;
  } else {
    felt.volume.isovalue = now.isovalue;
    felt.volume.normalized_isovalue = now.normalized_isovalue;
  }
  const auto take = [](const auto& was, const auto& is, auto& value) {
    if (was != is) value = is;
  };
  const RenderSettings& settings_before = saved.configured_settings;
  take(settings_before.method, settings_now.method, felt.settings.method);
  const HapticSettings& was = settings_before.haptics;
  const HapticSettings& is = settings_now.haptics;
  HapticSettings& haptics = felt.settings.haptics;
  take(was.free_side, is.free_side, haptics.free_side);
  for (const NumberSetting& setting : kNumberSettings) {
    take(was.*setting.member, is.*setting.member, haptics.*setting.member);
  }
  for (const FlagSetting& setting : kFlagSettings) {
    take(was.*setting.member, is.*setting.member, haptics.*setting.member);
  }
}

}  // namespace

SessionKeeper::SessionKeeper(const std::filesystem::path& folder,
                             const std::filesystem::path& socket, LoadRequest configured,
                             const RenderSettings& configured_settings, Felt felt)
    : path_(FileFor(folder, socket)),
      configured_(std::move(configured)),
      configured_settings_(configured_settings),
      felt_(std::move(felt)) {}

// Returns why the session is not restored; "" if it can be restored.
std::string SessionKeeper::WhyNot(const SessionFile& file) const {
  if (!file.damage.empty()) return path_.string() + " is damaged: " + file.damage;
  if (!IsSame(file.session->configured, configured_)) return "another volume is configured now";
  if (file.session->attempts < kMostAttempts) return "";
  return "palpated did not last with it, " + std::to_string(kMostAttempts) + " times";
}

std::optional<FeltSession> SessionKeeper::TakeLeft() {
  if (path_.empty()) return std::nullopt;
  SessionFile file = ReadSessionFile(path_);
  if (!file.session && file.damage.empty()) return std::nullopt;
  const std::string why_not = WhyNot(file);
  if (!why_not.empty()) {
    LogWarning("the previous session does not come back: {}", why_not);
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
    return std::nullopt;
  }
  SavedSession& saved = *file.session;
  attempts_ = ++saved.attempts;
  try {
    WriteSessionFile(path_, saved);
  } catch (const std::exception& error) {
    // The session comes back all the same: a full disk must not cost it.
    LogWarning("the attempt to bring the previous session back is not counted: {}", error.what());
  }
  taken_ = saved;
  TakeChanges(saved, configured_, configured_settings_, saved.felt);
  return saved.felt;
}

void SessionKeeper::GiveBack() noexcept {
  if (!taken_) return;
  try {
    --taken_->attempts;
    WriteSessionFile(path_, *taken_);
  } catch (const std::exception& error) {
    LogWarning("the previous session may not come back: {}", error.what());
  }
}

void SessionKeeper::Start() {
  if (!path_.empty()) thread_ = std::thread([this] { Run(); });
}

void SessionKeeper::Run() {
  pthread_setname_np(pthread_self(), "palpate-session");
  // Only the revisions and is_edited are compared.
  std::optional<FeltSession> saved;
  const auto lasts_at = std::chrono::steady_clock::now() + kLasting;
  std::unique_lock lock(mutex_);
  do {
    const FeltSession felt = felt_();
    const bool lasted = attempts_ > 0 && std::chrono::steady_clock::now() > lasts_at;
    if (lasted) attempts_ = 0;
    if (saved && !lasted && saved->settings_revision == felt.settings_revision &&
        saved->is_edited == felt.is_edited) {
      continue;
    }
    lock.unlock();
    const bool is_saved = Save(felt);
    lock.lock();
    if (is_saved) {
      saved = felt;
    } else {
      saved.reset();  // tried again
    }
  } while (!wake_.wait_for(lock, kInterval, [this] { return stop_; }));
}

bool SessionKeeper::Save(const FeltSession& felt) {
  try {
    WriteSessionFile(path_, {configured_, configured_settings_, attempts_, felt});
    last_failure_.clear();
    return true;
  } catch (const std::exception& error) {
    // A failure is logged once, not at every try.
    if (error.what() != last_failure_) {
      LogWarning("the session is not saved: {}; palpated tries again", error.what());
    }
    last_failure_ = error.what();
    return false;
  }
}

void SessionKeeper::Join() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void SessionKeeper::End() noexcept {
  Join();
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove(path_, ignored);
}

}  // namespace palpate
