#include "server/device/openhaptics/hd_library.h"

#include <dlfcn.h>

#include "common/error/error.h"

namespace palpate {
namespace {

void* Open(const std::string& path) {
  // NODELETE: threads of the library may still run its code after the last close.
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (library != nullptr) return library;
  const char* reason = dlerror();
  throw Error(ErrorKind::kNotFound, "cannot load " + path + " (" +
                                        (reason != nullptr ? reason : "no reason given") +
                                        "): install the vendor's OpenHaptics and device driver, or "
                                        "set [device] openhaptics_library");
}

template <class Function>
void Resolve(void* library, const std::string& path, const char* name, Function& function) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (function != nullptr) return;
  throw Error(ErrorKind::kNotFound,
              path + " has no function " + name +
                  ": it is not the vendor's HD library, or too old a one; "
                  "install OpenHaptics 3 or set [device] openhaptics_library");
}

}  // namespace

HdLibrary::HdLibrary(const std::string& path) {
  void* library = Open(path);
  const auto resolve = [&](const char* name, auto& function) {
    Resolve(library, path, name, function);
  };
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
