#include "server/recording/black_box.h"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <fstream>
#include <utility>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "common/files/new_file.h"
#include "server/recording/csv_export.h"

namespace palpate {
namespace {

// The most files that wait for a slow disk.
constexpr std::size_t kMostWaiting = 4;

bool IsCut(const TickSample& sample) {
  return sample.mode == ProxyMode::kFault || sample.force_state == ForceState::kFault ||
         sample.force_state == ForceState::kStopped;
}

// The reason why this tick cut off forces.
std::string ReasonOf(const TickSample& sample) {
  const bool is_safety =
      sample.force_state == ForceState::kFault || sample.force_state == ForceState::kStopped;
  if (is_safety && sample.force_reason != ForceReason::kOperator &&
      sample.force_reason != ForceReason::kNone) {
    return std::string(NameOf(sample.force_reason));
  }
  // The forces' state names no fault here: forces were off already.
  return sample.device_status == DeviceStatus::kFault ? "device" : "input";
}

// Such as "20261120T145203.123Z": the names sort by time.
std::string UtcNow() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
  const std::time_t seconds = ms / 1000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[32];
  const std::size_t length = std::strftime(text, sizeof text, "%Y%m%dT%H%M%S", &utc);
  char fraction[8];
  std::snprintf(fraction, sizeof fraction, ".%03dZ", static_cast<int>(ms % 1000));
  return std::string(text, length) + fraction;
}

void RemoveOldest(const std::filesystem::path& folder, std::string_view prefix) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(prefix) && name.ends_with(".csv")) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  for (std::size_t n = 0; n + BlackBox::kMostFiles < files.size(); ++n) {
    std::filesystem::remove(files[n]);
  }
}

}  // namespace

BlackBox::BlackBox(std::filesystem::path folder, Report report)
    : folder_(std::move(folder)), report_(std::move(report)), ring_(kTicks) {}

void BlackBox::Start() {
  if (folder_.empty()) return;
  thread_ = std::thread([this] { Run(); });
}

void BlackBox::Stop() noexcept {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  due_.notify_one();
  thread_.join();
}

void BlackBox::OnSample(const TickSample& sample) {
  ring_[samples_++ % kTicks] = sample;
  const bool is_cut = IsCut(sample);
  const bool begins = is_cut && !std::exchange(was_cut_, is_cut);
  was_cut_ = is_cut;
  if (!begins) return;
  const std::string reason = ReasonOf(sample);
  const double since_s = static_cast<double>(sample.time_ns - last_dump_ns_) * 1e-9;
  const bool is_again = reason == last_reason_ && since_s < kPauseS;
  std::vector<TickSample> ticks;
  if (!is_again) {
    last_reason_ = reason;
    last_dump_ns_ = sample.time_ns;
    ticks = Ticks();
  }
  {
    const std::lock_guard lock(mutex_);
    if (is_again || waiting_.size() == kMostWaiting) {
      // Reports only once: a cause that comes and goes must not fill the log.
      if (!std::exchange(has_skipped_, true)) skipped_ = reason;
    } else {
      has_skipped_ = false;
      waiting_.push_back({std::move(ticks), reason});
    }
  }
  due_.notify_one();
}

std::vector<TickSample> BlackBox::Ticks() const {
  const std::uint64_t count = std::min<std::uint64_t>(samples_, kTicks);
  std::vector<TickSample> ticks;
  ticks.reserve(count);
  for (std::uint64_t n = samples_ - count; n < samples_; ++n) ticks.push_back(ring_[n % kTicks]);
  return ticks;
}

void BlackBox::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    due_.wait(lock, [this] { return stop_ || !waiting_.empty() || !skipped_.empty(); });
    if (waiting_.empty() && skipped_.empty()) return;
    const auto waiting = std::exchange(waiting_, {});
    const std::string skipped = std::exchange(skipped_, {});
    lock.unlock();
    for (const Cut& cut : waiting) Write(cut);
    if (!skipped.empty()) report_("forces were cut off again (" + skipped + "); no file", false);
    lock.lock();
  }
}

void BlackBox::Write(const Cut& cut) const {
  const std::vector<TickSample>& ticks = cut.ticks;
  try {
    MakeFolders(folder_);
    const std::string prefix =
        ticks.back().force_state == ForceState::kStopped ? "stop-" : "fault-";
    const std::filesystem::path file = folder_ / (prefix + UtcNow() + "-" + cut.reason + ".csv");
    WriteWhole(file, [&](const std::filesystem::path& partial) {
      std::ofstream stream(partial);
      ExportCsv(ticks, stream);
    });
    RemoveOldest(folder_, prefix);
    report_("forces were cut off (" + cut.reason + "); the last " + std::to_string(ticks.size()) +
                " ticks are in " + file.string(),
            false);
  } catch (const std::exception& error) {
    report_("cannot keep the ticks before the fault in " + folder_.string() + ": " + error.what(),
            true);
  }
}

}  // namespace palpate
