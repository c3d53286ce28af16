// A script for a UsbProtocol between SetUp and TearDown, from the bytes of a fuzzer: transfers of a
// device that may send anything, and any forces.
//
//   step: a byte; even: a transfer of twice as many bytes, which follow;
//         odd: a force, 3 doubles; bit 1: forces are on
#pragma once

#include <array>
#include <cmath>

#include "server/device/usb/usb_protocol.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {

inline void CheckReading(const DeviceState& state, const DeviceSpec& spec) {
  FUZZ_CHECK(state.p_DHip_mm.allFinite());
  FUZZ_CHECK(state.p_DHip_mm.norm() < 1000.0);
  FUZZ_CHECK(std::abs(state.R_DS.norm() - 1.0) < 1e-6);
  FUZZ_CHECK((state.buttons >> spec.button_count) == 0);
}

inline bool IsSame(const DeviceState& a, const DeviceState& b) {
  return a.p_DHip_mm == b.p_DHip_mm && a.R_DS.coeffs() == b.R_DS.coeffs() &&
         a.buttons == b.buttons && a.docked == b.docked && a.calibrated == b.calibrated;
}

// check_frame(bytes, force_D_n, may_push) checks a frame to the device. may_push: forces are on and
// the last reading was calibrated.
template <typename CheckFrame>
void PlayScript(UsbProtocol& protocol, std::span<const std::uint8_t> bytes,
                CheckFrame check_frame) {
  Input input(bytes);
  DeviceState state{.calibrated = false};  // before the first reading
  while (!input.empty()) {
    const auto step = input.Take<std::uint8_t>();
    if (step % 2 == 0) {
      const auto transfer = input.TakeBytes(2u * step);
      const DeviceState before = state;
      const UsbReceived received = protocol.Receive(transfer, state);
      FUZZ_CHECK(received.has_reading == (received.readings > 0));
      FUZZ_CHECK(received.readings <= transfer.size());
      FUZZ_CHECK(received.corrupt_frames <= transfer.size() + 1);
      if (received.has_reading) {
        CheckReading(state, protocol.spec());
      } else {
        FUZZ_CHECK(IsSame(state, before));
      }
    } else {
      const Vec3 force_D_n = input.TakeVec3();
      const bool forces_on = (step & 2) != 0;
      std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
      const std::size_t size = protocol.Encode(force_D_n, forces_on, out);
      FUZZ_CHECK(size <= out.size());
      check_frame(std::span<const std::uint8_t>(out).first(size), force_D_n,
                  forces_on && state.calibrated);
    }
  }
}

}  // namespace palpate::fuzz
