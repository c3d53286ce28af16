// The HD library's error codes: what each means for the device.
//
// Threads: pure functions. Real-time: EffectOf does not allocate.
// Source: as hd_api.h; what follows from a code is our choice.
#pragma once

#include <cstdint>
#include <string>

#include "server/device/openhaptics/hd_api.h"

namespace palpate::hd {

// In the order of their weight.
enum class ErrorEffect : std::uint8_t {
  kNone,
  kWarning,  // to be told
  kCall,     // one call was refused; the rest of the frame is good
  kForce,    // the library refused the force: no forces for a while
  kFrame,    // nothing of this frame is good; if it goes on, the device is lost
  kBroken,   // the device is lost
};

ErrorEffect EffectOf(unsigned int code) noexcept;

// "HD_COMM_ERROR (0x302, internal 5): the device does not answer: ...".
std::string Describe(const ErrorInfo& error);

}  // namespace palpate::hd
