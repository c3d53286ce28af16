// `palpate device test`: judges the device by the ticks and the counts of a few seconds.
//
// Frame D (mm). Pure; one thread.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "client/cli/description.h"
#include "client/sdk/device.h"

namespace palpate::cli {

struct DeviceTestFigures {
  bool is_simulated = false;
  double seconds = 0.0;  // of the loop's time
  std::uint64_t ticks = 0;
  double ticks_per_s = 0.0;
  std::uint64_t missed_ticks = 0;
  std::uint64_t readings = 0;
  double readings_per_s = 0.0;
  std::uint64_t lost_readings = 0;
  double lost_percent = 0.0;
  std::uint64_t corrupt_frames = 0;
  double corrupt_percent = 0.0;
  std::uint64_t transfer_errors = 0;
  // Received samples, those with late readings, and those with a fault.
  std::uint64_t samples = 0;
  std::uint64_t stale_ticks = 0;
  std::uint64_t fault_ticks = 0;
  bool replayed = false;                // some samples were of a replay, not of the device
  std::array<double, 3> range_mm{};     // along each axis
  std::array<double, 3> noise_mm{};     // standard deviation along each axis
  bool rested = false;                  // the stylus rested, so noise_mm is noise and not motion
  std::uint32_t buttons = 0;            // bit n: button n was seen pressed
  client::ForceStatus forces{};         // at the end
  std::vector<std::string> failures{};  // empty: the device has passed
};

class DeviceTest {
 public:
  explicit DeviceTest(client::DaemonInfo before) : before_(std::move(before)) {}

  void Add(const client::Pose& pose);
  DeviceTestFigures Figures(const client::DaemonInfo& after) const;

 private:
  // Sums of the positions relative to the first one: small numbers keep their precision.
  struct Axis {
    double first_mm = 0.0;
    double low_mm = 0.0;
    double high_mm = 0.0;
    double sum_mm = 0.0;
    double sum_mm2 = 0.0;
  };

  client::DaemonInfo before_;
  DeviceTestFigures counts_;
  std::array<Axis, 3> axes_{};
};

// Returns lines that end with \n.
std::string Describe(const DeviceTestFigures& figures);
Json ToJson(const DeviceTestFigures& figures);

}  // namespace palpate::cli
