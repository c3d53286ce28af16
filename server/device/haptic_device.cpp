#include "server/device/haptic_device.h"

#include "common/error/error.h"

namespace palpate {

void RefuseCalibration(const std::string& kind) {
  throw Error(ErrorKind::kInvalidArgument,
              "the device `" + kind + "` needs no calibration: it has no place of rest");
}

}  // namespace palpate
