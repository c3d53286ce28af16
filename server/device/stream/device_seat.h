// One device's seat at the thread that talks to it: the newest reading and the newest command,
// which the servo and that thread exchange, and what is told of the device.
//
// If the servo does not write for kServoSilentMs, or after Hold, Next switches the motors off and
// Read returns kStale. This lasts until the servo writes zero, so that an old force does not come
// back in one step.
//
// Threads: Read and Write on the servo thread. What says "I/O" on the thread that talks to the
// device, which is a thread of a DeviceLink or of the vendor's library; one at a time. The rest on
// any ordinary thread.
// Real-time: Read, Write, Take and Next are wait-free.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>

#include "server/device/haptic_device.h"
#include "server/realtime/latest_value.h"

namespace palpate {

// Holds a device's reports for people: its present problem, its identity, and lines for the log,
// one per change.
//
// The log is short. If it is not read, the oldest lines are lost.
//
// Threads: any, with a lock that the servo never takes. Not real-time.
class DeviceLog {
 public:
  static constexpr std::size_t kMaxEvents = 64;

  // name: the start of every line.
  explicit DeviceLog(std::string name);

  // Sets the present problem and what to do; "": none. Adds a log line if the problem is new.
  void SetProblem(const std::string& problem,
                  DeviceEvent::Level level = DeviceEvent::Level::kWarning);
  // place: such as "USB port 1-2"; "": it has none.
  void SetConnected(const std::string& place, const std::string& identity);
  void Add(DeviceEvent::Level level, const std::string& text);

  std::optional<DeviceEvent> Next();
  // Fills in the identity and the problem.
  void FillIn(DeviceHealth& health) const;

 private:
  void Push(DeviceEvent::Level level, std::string text);

  const std::string name_;
  mutable std::mutex mutex_;
  std::deque<DeviceEvent> events_;
  std::string problem_;
  std::string identity_;
};

// Written by I/O, read by any thread.
struct SeatCounts {
  std::atomic<std::uint64_t> readings{0};
  std::atomic<std::uint64_t> forces_written{0};
  std::atomic<std::uint64_t> lost_readings{0};
  std::atomic<std::uint64_t> corrupt_frames{0};
  std::atomic<std::uint64_t> transfer_errors{0};
  std::atomic<std::uint64_t> connections{0};
  std::atomic<std::uint64_t> watchdog_zeros{0};
};

class DeviceSeat {
 public:
  static constexpr int kStaleAfterMs = 4;
  static constexpr int kServoSilentMs = 5;
  static constexpr int kSilentMs = 100;

  // name: the start of every line of the log.
  explicit DeviceSeat(const std::string& name) : log_(name) {}

  // The newest reading. kFault: the device does not stream, or has been silent for kSilentMs.
  // kStale: the reading is older than kStaleAfterMs.
  DeviceStatus Read(DeviceState& state) noexcept;
  void Write(const DeviceCommand& command) noexcept;

  // --- I/O
  // time_ns: when the reading came, by MonotonicNowNs.
  void Take(const DeviceState& state, std::int64_t time_ns) noexcept;
  // What the motors are to do now. Finite.
  DeviceCommand Next() noexcept;
  // The last Next has gone to the device.
  void CountSent() noexcept;
  // As if the servo had been silent: no force until it has written zero.
  void Hold() noexcept { watchdog_holds_ = true; }
  // `place`: where it is, such as "USB port 1-2". Call it after the first reading: before it, Read
  // returns kFault. Takes a lock.
  void BeStreaming(const std::string& place, const std::string& identity);
  void SetConnection(DeviceConnection connection) noexcept;
  bool is_streaming() const { return connection_ == DeviceConnection::kStreaming; }

  SeatCounts counts;
  DeviceLog& log() { return log_; }

  // `hint`: what to do while the device is not calibrated.
  DeviceHealth health(const std::string& hint) const;
  std::optional<DeviceEvent> NextEvent();

 private:
  // Eigen does not declare that copying a few numbers throws nothing.
  struct Reading {
    Reading& operator=(const Reading&) noexcept = default;
    DeviceState state{};
    std::int64_t time_ns = 0;
  };
  struct Command {
    Command& operator=(const Command&) noexcept = default;
    DeviceCommand command{};
    std::int64_t time_ns = 0;  // 0: the servo has not started
  };

  void ReportCorruptFrames();

  LatestValue<Reading> readings_;
  LatestValue<Command> commands_;
  std::atomic<DeviceConnection> connection_{DeviceConnection::kAbsent};
  std::atomic<bool> watchdog_holds_{false};
  bool servo_is_silent_ = false;  // I/O's: at the last Next
  std::atomic<bool> docked_{false};
  std::atomic<bool> calibrated_{false};

  // I/O only counts. The caller of NextEvent makes log lines from the counts.
  DeviceLog log_;
  std::mutex report_mutex_;  // guards the next two
  std::uint64_t corrupt_frames_told_ = 0;
  std::int64_t corrupt_report_ns_ = 0;
};

}  // namespace palpate
