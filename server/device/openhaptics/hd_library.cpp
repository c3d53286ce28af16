#include "server/device/openhaptics/hd_library.h"

#include "server/device/stream/vendor_library.h"

namespace palpate {

HdLibrary::HdLibrary(const std::string& path) {
  const VendorLibrary library(path, "the vendor's HD library",
                              "install the vendor's OpenHaptics 3 and device driver, or set "
                              "[device] openhaptics_library");
  const auto resolve = [&](const char* name, auto& function) { library.Resolve(name, function); };
  resolve("hdInitDevice", functions_.init_device);
  resolve("hdDisableDevice", functions_.disable_device);
  resolve("hdMakeCurrentDevice", functions_.make_current);
  resolve("hdBeginFrame", functions_.begin_frame);
  resolve("hdEndFrame", functions_.end_frame);
  resolve("hdEnable", functions_.enable);
  resolve("hdDisable", functions_.disable);
  resolve("hdGetBooleanv", functions_.get_booleanv);
  resolve("hdGetIntegerv", functions_.get_integerv);
  resolve("hdGetDoublev", functions_.get_doublev);
  resolve("hdSetDoublev", functions_.set_doublev);
  resolve("hdGetString", functions_.get_string);
  resolve("hdGetError", functions_.get_error);
  resolve("hdCheckCalibration", functions_.check_calibration);
  resolve("hdUpdateCalibration", functions_.update_calibration);
  resolve("hdSetSchedulerRate", functions_.set_scheduler_rate);
  resolve("hdScheduleAsynchronous", functions_.schedule_asynchronous);
  resolve("hdUnschedule", functions_.unschedule);
  resolve("hdStartScheduler", functions_.start_scheduler);
  resolve("hdStopScheduler", functions_.stop_scheduler);
}

}  // namespace palpate
