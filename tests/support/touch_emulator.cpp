#include "tests/support/touch_emulator.h"

#include <algorithm>
#include <cmath>

#include "server/device/omni/kinematics.h"

namespace palpate::test {
namespace {

constexpr std::uint8_t kSync0 = 0xa5, kSync1 = 0x5a;
constexpr std::size_t kHeadBytes = 4;

constexpr std::uint8_t kFirmwareQuery = 0x0f, kFirmwareAnswer = 0x0e, kSerialQuery = 0x0c,
                       kSerialAnswer = 0x09, kServo = 0x07;
constexpr unsigned kMostWaitMs = 20;
constexpr std::size_t kFirmwareBytes = 0x20, kSerialBytes = 0x61;

UsbSpec TouchSpec() {
  return {.vendor = 0x2988,
          .product = 0x0302,
          .device_class = 2,
          .interfaces = {{.device_class = 2,
                          .subclass = 2,
                          .protocol = 1,
                          .endpoints = {{.address = TouchEmulator::kNotify,
                                         .type = 3,
                                         .packet_bytes = 8,
                                         .interval = 9}},
                          .kernel_driver = "cdc_acm"},
                         {.device_class = 10,
                          .endpoints = {{.address = TouchEmulator::kDataIn, .packet_bytes = 512},
                                        {.address = TouchEmulator::kDataOut, .packet_bytes = 512}},
                          .kernel_driver = "cdc_acm"}}};
}

void PutWord(unsigned word, std::size_t at, Bytes& bytes) {
  bytes[at] = static_cast<std::uint8_t>(word);
  bytes[at + 1] = static_cast<std::uint8_t>(word >> 8);
}

unsigned Word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<unsigned>(bytes[at] | bytes[at + 1] << 8);
}

std::int16_t Counts(double angle_rad) {
  return static_cast<std::int16_t>(std::lround(angle_rad / kOmniRadPerCount));
}

}  // namespace

TouchEmulator::TouchEmulator() : EmulatedUsbDevice(TouchSpec()) {}

void TouchEmulator::SetPath(Path path) {
  const std::scoped_lock lock(mutex());
  path_ = std::move(path);
  path_begin_ = counter_;
}

void TouchEmulator::SetDocked(bool docked) {
  const std::scoped_lock lock(mutex());
  docked_ = docked;
}

void TouchEmulator::SetButtons(bool first, bool second) {
  const std::scoped_lock lock(mutex());
  buttons_ = {first, second};
}

void TouchEmulator::SetLossEvery(unsigned n) {
  const std::scoped_lock lock(mutex());
  loss_every_ = n;
}

void TouchEmulator::SetWaitsForForces(bool waits) {
  const std::scoped_lock lock(mutex());
  waits_for_forces_ = waits;
  waited_ms_ = 0;
}

void TouchEmulator::SetBadFrameEvery(unsigned n) {
  const std::scoped_lock lock(mutex());
  bad_every_ = n;
}

bool TouchEmulator::is_streaming() const {
  const std::scoped_lock lock(mutex());
  return streaming_;
}

std::vector<TouchForce> TouchEmulator::Forces() const {
  const std::scoped_lock lock(mutex());
  return forces_;
}

Bytes TouchEmulator::Commands() const {
  const std::scoped_lock lock(mutex());
  return commands_;
}

std::size_t TouchEmulator::garbage_bytes() const {
  const std::scoped_lock lock(mutex());
  return garbage_bytes_;
}

void TouchEmulator::OnPlugged() {
  received_.clear();
  streaming_ = false;
  counter_ = path_begin_ = 0;
}

std::optional<std::size_t> TouchEmulator::OnControl(const UsbSetup& setup,
                                                    std::span<std::uint8_t> data) {
  // Line coding, line state and break of a CDC-ACM device; they change nothing here.
  if ((setup.request_type & 0x7f) == 0x21 && setup.request >= 0x20 && setup.request <= 0x23) {
    return data.size();
  }
  return std::nullopt;
}

void TouchEmulator::OnOut(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) {
  if (endpoint != kDataOut) return;
  received_.insert(received_.end(), bytes.begin(), bytes.end());
  std::size_t at = 0;
  while (received_.size() - at >= kHeadBytes) {
    if (received_[at] != kSync0 || received_[at + 1] != kSync1) {
      ++at;
      ++garbage_bytes_;
      continue;
    }
    const std::size_t length = received_[at + 3];
    if (received_.size() - at < kHeadBytes + length) break;
    TakeFrame(received_[at + 2], std::span(received_).subspan(at + kHeadBytes, length));
    at += kHeadBytes + length;
  }
  received_.erase(received_.begin(), received_.begin() + static_cast<std::ptrdiff_t>(at));
}

void TouchEmulator::TakeFrame(std::uint8_t command, std::span<const std::uint8_t> payload) {
  if (command == kForceCommand && payload.size() == kOmniForceBytes) {
    TouchForce force{.enabled = (Word(payload, 6) & 1u << 3) != 0};
    for (std::size_t n = 0; n < 3; ++n) {
      force.motors[n] = static_cast<int>(Word(payload, 2 * n)) - kOmniMotorRange;
    }
    forces_.push_back(force);
    waited_ms_ = kMostWaitMs;
    return;
  }
  commands_.push_back(command);
  if (command == kFirmwareQuery) {
    Bytes answer(kFirmwareBytes);
    const std::string version = "emulated 1.0";
    std::copy(version.begin(), version.end(), answer.begin());
    Send(kFirmwareAnswer, answer);
  } else if (command == kSerialQuery) {
    Bytes answer(kSerialBytes);
    const std::string serial = "EMULATED0001";
    std::copy(serial.begin(), serial.end(), answer.begin());
    Send(kSerialAnswer, answer);
  } else if (command == kServo && !payload.empty()) {
    streaming_ = payload[0] != 0;
  }
}

void TouchEmulator::Send(std::uint8_t command, std::span<const std::uint8_t> payload, bool bad) {
  Bytes frame = {bad ? std::uint8_t{0} : kSync0, kSync1, command,
                 static_cast<std::uint8_t>(payload.size())};
  frame.insert(frame.end(), payload.begin(), payload.end());
  QueueIn(kDataIn, std::move(frame));
}

void TouchEmulator::OnMillisecond() {
  if (!streaming_) return;
  if (waits_for_forces_ && waited_ms_++ < kMostWaitMs) return;
  waited_ms_ = 0;
  ++counter_;
  if (loss_every_ != 0 && counter_ % loss_every_ == 0) return;
  const bool bad = bad_every_ != 0 && counter_ % bad_every_ == 0;
  Send(kStateCommand, StateFrame(), bad);
}

Bytes TouchEmulator::StateFrame() {
  if (path_) {
    OmniJoints joints;
    const double time_s = 1e-3 * (counter_ - path_begin_);
    if (OmniJointsAt(path_(time_s), joints)) {
      encoders_ = {Counts(joints.base_rad), Counts(-joints.shoulder_rad), Counts(joints.elbow_rad)};
    }
  }
  Bytes frame(kOmniStateBytes);
  for (std::size_t n = 0; n < 3; ++n) {
    PutWord(static_cast<std::uint16_t>(encoders_[n]), 4 + 2 * n, frame);
    PutWord(0x800, 10 + 2 * n, frame);  // gimbal in the middle
    PutWord(0x800, 22 + 2 * n, frame);
  }
  const unsigned active = (buttons_[0] ? 1u : 0u) | (buttons_[1] ? 2u : 0u) | (docked_ ? 4u : 0u);
  frame[19] = static_cast<std::uint8_t>(~active);
  PutWord(counter_, 32, frame);
  PutWord(counter_ >> 16, 34, frame);
  return frame;
}

}  // namespace palpate::test
