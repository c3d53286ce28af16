#include "server/app/instrument.h"

#include <algorithm>
#include <string>

#include "common/contract/enumerations.h"
#include "server/log/log.h"

namespace palpate {
namespace {

void LogBlackBox(const std::string& text, bool is_error) {
  Log(is_error ? LogLevel::kError : LogLevel::kInfo, "{}", text);
}

// Logs what the operator must know before the hardware moves.
void ReportDevice(const DeviceDescription& spec) {
  if (!IsHardware(spec)) return;
  if (!(spec.max_force_n > 0.0)) {
    LogWarning("device {} ({}): verification level {}; it gets no force", spec.kind, spec.model,
               NameOf(spec.verification_level));
    return;
  }
  LogWarning("device {}: verification level {}; forces are off until `palpate device enable {}`",
             spec.kind, NameOf(spec.verification_level), spec.kind);
}

void ReportGrant(const RealtimeGrant& grant) {
  for (const std::string& warning : grant.warnings) LogWarning("{}", warning);
  LogInfo("servo loop at 1000 Hz, {} scheduling, memory {}", grant.fifo ? "SCHED_FIFO" : "ordinary",
          grant.memory_locked ? "locked" : "not locked");
}

}  // namespace

// The device's thread gets a lower priority than the servo, and the stop's a lower one than that,
// if there is one.
Instrument::Instrument(const Config& config, const std::filesystem::path& state_folder)
    : device(MakeDevice(config.device, std::max(1, config.realtime.priority - 1), hand)),
      outbox(std::make_unique<TickOutbox>()),
      pump(*outbox, inbox),
      forces(outbox->last),
      limits(LimitsFor(device->spec(), StopButtons(config.device, device->spec()))),
      servo(*device, inbox, *outbox, config.realtime, limits),
      stop_door(servo, outbox->last, *device, std::max(1, config.realtime.priority - 2)),
      monitor_(std::make_shared<DeviceMonitor>(*device)),
      black_box_(std::make_shared<BlackBox>(
          state_folder.empty() ? state_folder : state_folder / "faults", LogBlackBox)) {
  pump.Subscribe(monitor_);
  pump.Subscribe(black_box_);
}

Instrument::~Instrument() {
  servo.Stop();
  pump.Stop();
}

void Instrument::Start() {
  monitor_->Start();
  black_box_->Start();
  pump.Start();
  servo.Start();
  ReportGrant(servo.grant());
  ReportDevice(device->spec());
}

}  // namespace palpate
