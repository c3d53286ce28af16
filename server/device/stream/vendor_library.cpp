#include "server/device/stream/vendor_library.h"

#include <dlfcn.h>

#include <utility>

#include "common/error/error.h"

namespace palpate {

VendorLibrary::VendorLibrary(const std::string& path, std::string what, std::string advice)
    : path_(path), what_(std::move(what)), advice_(std::move(advice)) {
  // NODELETE: threads of the library may still run its code after the last close.
  library_ = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (library_ != nullptr) return;
  const char* reason = dlerror();
  throw Error(ErrorKind::kNotFound, "cannot load " + path + " (" +
                                        (reason != nullptr ? reason : "no reason given") +
                                        "): " + advice_);
}

void* VendorLibrary::Find(const char* name) const {
  if (void* const function = dlsym(library_, name)) return function;
  throw Error(ErrorKind::kNotFound, path_ + " has no function " + name + ": it is not " + what_ +
                                        ", or too old a one: " + advice_);
}

}  // namespace palpate
