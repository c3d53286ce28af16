#include "server/kept/session_keeper.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>
#include <system_error>
#include <tuple>
#include <utility>

#include "common/error/error.h"
#include "common/files/text_file.h"
#include "server/log/log.h"

namespace palpate {
namespace {

// For example run-palpate-palpated.sock.toml.
std::filesystem::path FileFor(const std::filesystem::path& folder,
                              const std::filesystem::path& socket) {
  if (folder.empty()) return {};
  std::string name;
  // A socket has one name, and no two sockets have the same.
  for (const char c : std::filesystem::weakly_canonical(socket).string().substr(1)) {
    name += c == '/' ? "-" : c == '-' ? "%2d" : c == '%' ? "%25" : std::string(1, c);
  }
  return folder / "sessions" / (name + ".toml");
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

// 0 for what is no such file.
std::uint64_t EditsIn(const std::filesystem::path& path) {
  std::uint64_t edits = 0;
  try {
    const std::string bytes = ReadTextFile(path, sizeof edits);
    if (bytes.size() == sizeof edits) std::memcpy(&edits, bytes.data(), sizeof edits);
  } catch (const Error&) {
    // Nobody has edited.
  }
  return edits;
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

// Opens no pipe, link or folder of somebody else.
void SessionKeeper::OpenEdits() {
  std::error_code ignored;
  std::filesystem::create_directories(path_.parent_path(), ignored);  // Save says it
  struct stat status {};
  edits_file_ = Descriptor(
      open(edits_path_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600));
  const bool is_file = fstat(edits_file_.get(), &status) == 0 && S_ISREG(status.st_mode);
  if (!is_file) edits_file_ = Descriptor();
  edits_descriptor_ = edits_file_.get();
  NoteEdits(edits_);  // takes its place on the disk, which may be full later
}

void SessionKeeper::NoteEdits(std::uint64_t unsaved_edits) noexcept {
  edits_ = unsaved_edits;
  [[maybe_unused]] const ssize_t written =
      pwrite(edits_descriptor_, &unsaved_edits, sizeof unsaved_edits, 0);
}

std::string SessionKeeper::WhyNot(const SessionFile& file) const {
  if (!file.damage.empty()) return path_.string() + " is damaged: " + file.damage;
  if (file.session->attempts < kMostAttempts) return "";
  return "palpated did not last with it, " + std::to_string(kMostAttempts) + " times";
}

void SessionKeeper::Forget(const std::string& why) {
  const std::string line = "the previous session does not come back: " + why;
  ended_cleanly_ ? LogInfo("{}", line) : LogWarning("{}", line);
  std::error_code ignored;
  std::filesystem::remove(path_, ignored);
}

std::optional<FeltSession> SessionKeeper::TakeLeft(bool fresh) {
  if (path_.empty()) return std::nullopt;
  SessionFile file = ReadSessionFile(path_);
  if (!file.session && file.damage.empty()) return std::nullopt;
  ended_cleanly_ = file.session && file.session->ended_cleanly;
  lost_edits_ = EditsIn(edits_path_);
  if (fresh) return Forget("palpated starts as configured (--fresh)"), std::nullopt;
  if (file.session && !IsSame(file.session->configured, configured_)) {
    return Forget("another volume is configured now"), std::nullopt;
  }
  why_not_ = WhyNot(file);
  if (!why_not_.empty()) return Forget(why_not_), std::nullopt;
  SavedSession& saved = *file.session;
  attempts_ = ++saved.attempts;
  saved.ended_cleanly = false;
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
    taken_->ended_cleanly = ended_cleanly_;
    WriteSessionFile(path_, *taken_);
  } catch (const std::exception& error) {
    LogWarning("the previous session may not come back: {}", error.what());
  }
}

void SessionKeeper::Start() {
  if (path_.empty()) return;
  OpenEdits();
  lasts_at_ = std::chrono::steady_clock::now() + kLasting;
  saver_.emplace("palpate-session", kLook, [this](bool at_once) { return SaveChanges(at_once); });
  is_started_ = true;
}

std::string SessionKeeper::Await() {
  if (path_.empty()) return "";
  return is_started_ ? saver_->Await() : "palpated is starting or ending";
}

std::string SessionKeeper::failure() const { return is_started_ ? saver_->failure() : ""; }

std::string SessionKeeper::SaveChanges(bool at_once) {
  if (const std::uint64_t edits = edits_; std::exchange(edits_on_disk_, edits) != edits) {
    if (edits_descriptor_ < 0) OpenEdits();
    fdatasync(edits_descriptor_);
  }
  const FeltSession felt = felt_();
  const auto now = std::chrono::steady_clock::now();
  const bool lasted = attempts_ > 0 && now > lasts_at_;
  if (lasted) attempts_ = 0;
  if (!lasted && saved_revision_ == felt.settings_revision) return "";
  if (!at_once && now < retry_at_) return last_failure_;
  const std::string failure = Write({configured_, configured_settings_, attempts_, false, felt});
  saved_revision_.reset();
  if (failure.empty()) saved_revision_ = felt.settings_revision;
  if (!failure.empty()) retry_at_ = now + kAfterFailure;
  return failure;
}

std::string SessionKeeper::Write(const SavedSession& session) {
  std::string failure;
  try {
    WriteSessionFile(path_, session);
  } catch (const std::exception& error) {
    failure = error.what();
  }
  // A failure is logged once, not at every try.
  if (!failure.empty() && failure != last_failure_) {
    LogWarning("the session is not saved: {}; palpated tries again", failure);
  }
  return last_failure_ = failure;
}

void SessionKeeper::End() noexcept {
  if (!is_started_.exchange(false)) return;
  saver_->Stop();
  Write({configured_, configured_settings_, 0, true, felt_()});
}

}  // namespace palpate
