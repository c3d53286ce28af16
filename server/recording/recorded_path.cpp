#include "server/recording/recorded_path.h"

#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <variant>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr double kTickS = 0.001;
constexpr double kTickToleranceS = 1e-9;
constexpr double kUnitTolerance = 1e-3;

// Returns none if the tick had no good position.
std::optional<DeviceState> StateOf(const TickSample& sample) {
  const auto& [w, x, y, z] = sample.stylus_orientation;
  const Eigen::Quaterniond R_MS(w, x, y, z);
  DeviceState state;
  state.p_MHip_mm = Vec3(sample.hip_mm.data());
  const bool is_pose =
      state.p_MHip_mm.allFinite() && std::abs(R_MS.coeffs().norm() - 1.0) < kUnitTolerance;
  if (sample.input_rejected || !is_pose) return std::nullopt;
  state.R_MS = R_MS;
  state.buttons = sample.buttons;
  state.docked = sample.docked;
  state.calibrated = sample.calibrated;
  return state;
}

class PathBuilder {
 public:
  PathBuilder(std::string name, std::size_t longest) : name_(std::move(name)), longest_(longest) {}

  void Add(const TickSample& sample) {
    const std::optional<DeviceState> state = StateOf(sample);
    // Missed ticks have no number, so they are added here.
    const std::uint64_t now_ms = sample.tick + sample.missed_ticks;
    if (path_.empty()) {
      if (!state) return;
      start_ms_ = now_ms;
    }
    if (now_ms < start_ms_ || now_ms - start_ms_ < path_.size()) {
      Refuse(name_ + " is damaged: its ticks run backwards");
    }
    const std::uint64_t index = now_ms - start_ms_;
    if (index >= longest_) {
      throw Error(ErrorKind::kTooLarge, name_ + " is longer than " + std::to_string(longest_) +
                                            " ms; replay a shorter recording");
    }
    if (index > path_.size()) path_.resize(index, path_.back());
    path_.push_back(state ? *state : path_.back());
  }

  std::vector<DeviceState> Take() { return std::move(path_); }

 private:
  std::string name_;
  std::size_t longest_;
  std::vector<DeviceState> path_;
  std::uint64_t start_ms_ = 0;
};

}  // namespace

std::vector<DeviceState> ReadStylusPath(const std::filesystem::path& file, std::size_t longest) {
  RecordingReader reader(file);
  return ReadStylusPath(reader, file.string(), longest);
}

std::vector<DeviceState> ReadStylusPath(RecordingReader& reader, const std::string& name,
                                        std::size_t longest) {
  PathBuilder builder(name, longest);
  while (const std::optional<RecordedItem> item = reader.Next()) {
    if (const auto* scene = std::get_if<RecordedScene>(&*item)) {
      if (!(std::abs(scene->tick_period_s - kTickS) < kTickToleranceS)) {
        Refuse(name + " was not recorded at 1000 ticks a second; the replay device cannot play it");
      }
    } else if (const auto* samples = std::get_if<RecordedSamples>(&*item)) {
      for (const TickSample& sample : *samples) builder.Add(sample);
    }
  }
  if (!reader.complete()) {
    throw Error(ErrorKind::kInvalidArgument,
                reader.stopped_because() + "; a replay needs a complete recording");
  }
  std::vector<DeviceState> path = builder.Take();
  if (path.empty())
    Refuse(name + " holds no position of the stylus, so there is nothing to replay");
  return path;
}

}  // namespace palpate
