// The vendor's HD library, loaded at run time: a build needs neither it nor its
// headers.
//
// Threads: constructed on one thread; the functions as the vendor says. Real-time: none.
// Ownership: the library stays in memory until the process ends, because its threads
// may outlive a device.
// Errors: Error (kNotFound) where it or one of its functions is missing.
#pragma once

#include <string>

#include "server/device/openhaptics/hd_api.h"

namespace palpate {

class HdLibrary {
 public:
  static constexpr const char* kDefaultPath = "libHD.so";

  // path: a file, or a name that the loader searches for.
  explicit HdLibrary(const std::string& path);

  const hd::Functions& functions() const { return functions_; }

 private:
  hd::Functions functions_;
};

}  // namespace palpate
