// An opened device of Force Dimension's library. forcedimension_bus.h says what it does.
//
// Threads, errors: as StreamSession.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "server/device/forcedimension/forcedimension_bus.h"
#include "server/realtime/tick_timer.h"

namespace palpate {

class FdSession final : public StreamSession {
 public:
  // Borrows all, and owns the opened ID.
  FdSession(const FdLibrary& library, char id, const FdModel& model,
            const ForceDimensionOptions& options, ForceDimensionBus::Exchange& exchange);
  ~FdSession() override;

  void SetUp(const std::atomic<bool>& stop) override;
  std::string place() const override { return ""; }
  std::string identity() const override { return identity_; }
  StreamReceived Wait(std::chrono::microseconds longest, DeviceState& state) override;
  bool TrySend(const DeviceCommand& command) override;
  std::uint64_t transfer_errors() const override { return errors_; }
  bool LetGo() noexcept override;

 private:
  FdAbilities Abilities() const;
  // Returns whether the device will brake by itself.
  bool SetWatchdog();
  bool HasWatchdog();
  void TakeReading(StreamReceived& received, DeviceState& state);
  using Status = std::array<int, fd::kStatusRoom>;
  // Returns false if the device does not tell it. Throws after some times in a row.
  bool ReadStatus(Status& status);
  // Throws what ended the device's forces, if its motors should be on.
  void CheckMotors(const Status& status);
  void Watch(StreamReceived& received);
  void WatchMotors(const Status& status, StreamReceived& received);
  const char* HintOf(const Status& status) const;
  // After the warning, unless something speaks against it.
  void PrepareCalibration(const Status& status, StreamReceived& received);
  void Calibrate(StreamReceived& received);
  void Switch(bool on);
  int SetWrench(const Wrench& wrench_M);
  // Returns whether a call went well. Throws if the device is gone, or after some errors in a row.
  bool Check(int result, const char* call, int& errors_in_a_row);

  const FdLibrary& library_;
  const fd::Functions& fd_;
  const char id_;
  const FdModel& model_;
  const ForceDimensionOptions& options_;
  ForceDimensionBus::Exchange& exchange_;

  std::string identity_;
  Vec3 centre_m_ = Vec3::Zero();
  bool brakes_itself_ = false;
  bool is_open_ = true;
  TickTimer timer_;
  std::uint64_t missed_ = 0;  // ticks, as told so far
  std::int64_t next_watch_ns_ = 0;
  std::uint64_t errors_ = 0;
  int bad_readings_ = 0, bad_forces_ = 0, bad_statuses_ = 0, bad_switches_ = 0;  // in a row
  bool knows_calibration_ = false;
  bool is_calibrated_ = false;
  bool wants_motors_ = false;  // by the last command
  bool motors_on_ = false;
  bool has_been_on_ = false;  // by the device's status, since they were switched on
  std::int64_t switched_ns_ = 0, commanded_ns_ = 0;
  std::int64_t calibrates_at_ns_ = 0;  // 0: it does not
  std::int64_t saturated_since_ns_ = 0;
  std::int64_t saturation_told_ns_ = 0;
};

}  // namespace palpate
