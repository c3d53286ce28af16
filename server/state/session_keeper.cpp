#include "server/state/session_keeper.h"

#include <fcntl.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <system_error>
#include <tuple>
#include <utility>

#include "common/error/error.h"
#include "common/files/new_file.h"
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
  const HapticSettings& was = settings_before.haptics;
  const HapticSettings& is = settings_now.haptics;
  HapticSettings& haptics = felt.settings.haptics;
  for (const ChoiceSetting& setting : kChoiceSettings) {
    if (setting.get(was) != setting.get(is)) setting.set(haptics, setting.get(is));
  }
  for (const NumberSetting& setting : kNumberSettings) {
    take(was.*setting.member, is.*setting.member, haptics.*setting.member);
  }
  for (const FlagSetting& setting : kFlagSettings) {
    take(was.*setting.member, is.*setting.member, haptics.*setting.member);
  }
  take(was.layers, is.layers, haptics.layers);
  take(was.tool, is.tool, haptics.tool);
  if (haptics.free_side == FreeSide::kAbove && !haptics.layers.layer.empty()) {
    LogWarning("layers do not come back: they are felt from below, and free_side is above");
    haptics.layers = {};
  }
}

}  // namespace

SessionKeeper::SessionKeeper(const std::filesystem::path& folder,
                             const std::filesystem::path& socket, LoadRequest configured,
                             const RenderSettings& configured_settings, Felt felt)
    : path_(FileFor(folder, socket)),
      edits_path_(path_.string() + ".edits"),
      configured_(std::move(configured)),
      configured_settings_(configured_settings),
      felt_(std::move(felt)) {}

void SessionKeeper::OpenEdits() {
  try {
    MakeFolders(path_.parent_path());
  } catch (const Error&) {
    return;  // Save says it
  }
  edits_file_ =
      Descriptor(open(edits_path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
}

void SessionKeeper::NoteEdits(std::uint64_t unsaved_edits) noexcept {
  edits_ = unsaved_edits;
  [[maybe_unused]] const ssize_t written =
      pwrite(edits_file_.get(), &unsaved_edits, sizeof unsaved_edits, 0);
}

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
  std::ifstream(edits_path_, std::ios::binary)
      .read(reinterpret_cast<char*>(&lost_edits_), sizeof lost_edits_);
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
  if (path_.empty()) return;
  OpenEdits();
  thread_ = std::thread([this] { Run(); });
}

void SessionKeeper::Run() {
  pthread_setname_np(pthread_self(), "palpate-session");
  std::optional<std::uint64_t> saved;  // revision of the settings
  std::uint64_t on_disk = 0;           // edits
  std::chrono::steady_clock::time_point retry_at{};
  const auto lasts_at = std::chrono::steady_clock::now() + kLasting;
  std::unique_lock lock(mutex_);
  do {
    if (const std::uint64_t edits = edits_; std::exchange(on_disk, edits) != edits) {
      lock.unlock();
      fdatasync(edits_file_.get());
      lock.lock();
    }
    const FeltSession felt = felt_();
    const auto now = std::chrono::steady_clock::now();
    const bool lasted = attempts_ > 0 && now > lasts_at;
    if (lasted) attempts_ = 0;
    if ((!lasted && saved == felt.settings_revision) || now < retry_at) continue;
    lock.unlock();
    saved = Save(felt) ? std::optional(felt.settings_revision) : std::nullopt;
    if (!saved) retry_at = now + kAfterFailure;
    lock.lock();
  } while (!wake_.wait_for(lock, kLook, [this] { return stop_; }));
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
  if (path_.empty()) return;
  std::filesystem::remove(path_, ignored);
  std::filesystem::remove(edits_path_, ignored);
}

}  // namespace palpate
