// Loads the vendor's HD library at run time.
//
// Threads: construct on one thread; the functions as the vendor says. Not real-time.
// Ownership, errors: as VendorLibrary.
#pragma once

#include <string>

#include "server/device/openhaptics/hd_api.h"

namespace palpate {

class HdLibrary {
 public:
  static constexpr const char* kDefaultPath = "libHD.so";

  // path: a file, or a name for which the loader searches.
  explicit HdLibrary(const std::string& path);

  const hd::Functions& functions() const { return functions_; }

 private:
  hd::Functions functions_;
};

}  // namespace palpate
