#include "server/simulated_hand/replay_device.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "server/simulated_hand/simulated_device.h"

namespace palpate {
namespace {

constexpr double kNsPerS = 1e9;
constexpr std::int64_t kNsPerState = 1'000'000;
constexpr double kUnitTolerance = 1e-3;

bool IsPose(const DeviceState& state) {
  const Eigen::Vector4d& xyzw = state.R_MS.coeffs();
  return state.p_MHip_mm.allFinite() && std::abs(xyzw.norm() - 1.0) < kUnitTolerance;
}

void Check(const std::vector<DeviceState>& path) {
  if (path.empty()) {
    throw Error(ErrorKind::kInvalidArgument,
                "a replayed stylus needs a path of one state at least");
  }
  const auto bad = std::ranges::find_if_not(path, IsPose);
  if (bad == path.end()) return;
  throw Error(ErrorKind::kInvalidArgument,
              "state " + std::to_string(bad - path.begin()) +
                  " of the stylus's path is no pose: it must be finite, its orientation a unit "
                  "quaternion");
}

}  // namespace

DeviceDescription ReplayDeviceSpec() {
  DeviceDescription spec = SimulatedDeviceSpec();
  spec.kind = "replay";
  spec.model = "Replay of a recorded stylus";
  return spec;
}

ReplayDevice::ReplayDevice(std::vector<DeviceState> path)
    : spec_(ReplayDeviceSpec()), path_(std::move(path)) {
  Check(path_);
  // The states at both ends are played once per round.
  const auto steps = static_cast<std::int64_t>(2 * (path_.size() - 1));
  round_ns_ = std::max<std::int64_t>(steps, 1) * kNsPerState;
}

void ReplayDevice::Start() {
  started_ = true;
  time_ns_ = 0;
  last_ = {};
}

DeviceStatus ReplayDevice::Read(DeviceState& state) noexcept {
  if (!started_) return DeviceStatus::kFault;
  const auto step = static_cast<std::size_t>(time_ns_ / kNsPerState);
  const std::size_t last = path_.size() - 1;
  state = path_[step <= last ? step : 2 * last - step];
  return DeviceStatus::kOk;
}

// Counts whole nanoseconds: sums of doubles would miss a state from time to time.
void ReplayDevice::Write(const DeviceCommand& command, double dt_s) noexcept {
  if (!started_ || !(dt_s > 0.0)) return;
  last_ = command;
  time_ns_ += std::llround(std::min(dt_s, kLongestMoveS) * kNsPerS);
  time_ns_ %= round_ns_;
}

}  // namespace palpate
