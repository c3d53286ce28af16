// The HD library's error codes, and what each code means for the device.
//
// Threads: pure functions. Real-time: EffectOf does not allocate.
// Source: as hd_api.h. The effect of each code is our choice.
#pragma once

#include <cstdint>
#include <string>

#include "server/device/openhaptics/hd_api.h"

namespace palpate::hd {

// In ascending order of weight.
enum class ErrorEffect : std::uint8_t {
  kNone,
  kWarning,  // only reported
  kCall,     // one call was refused; the rest of the frame is good
  kForce,    // the library refused the force: no forces for a while
  kFrame,    // the frame is invalid; if this continues, the device is lost
  kBroken,   // the device is lost
};

ErrorEffect EffectOf(unsigned int code) noexcept;

// "HD_COMM_ERROR (0x302, internal 5): the device does not answer: ...".
std::string Describe(const ErrorInfo& error);

}  // namespace palpate::hd
