#include "server/device/haptic_device.h"

#include "common/error/error.h"

namespace palpate {

void HapticDevice::Calibrate() {
  throw Error(ErrorKind::kInvalidArgument,
              "the device `" + spec().kind + "` needs no calibration: it has no place of rest");
}

}  // namespace palpate
