#include "server/device/haptic_device.h"

#include "common/error/error.h"

namespace palpate {

std::string_view NameOf(VerificationLevel level) {
  switch (level) {
    case VerificationLevel::kNone:
      return "none";
    case VerificationLevel::kEnumerated:
      return "enumerated";
    case VerificationLevel::kIdentified:
      return "identified";
    case VerificationLevel::kStateRead:
      return "state read";
    case VerificationLevel::kForceVerified:
      return "force verified";
    case VerificationLevel::kSimulated:
      return "simulated";
  }
  return "none";
}

void HapticDevice::Calibrate() {
  throw Error(ErrorKind::kInvalidArgument,
              "the device `" + spec().kind + "` needs no calibration: it has no place of rest");
}

}  // namespace palpate
