// Loads Force Dimension's library at run time: libdrd, which has the functions of libdhd, too.
//
// Threads, ownership: as VendorLibrary.
// Errors: Error (kNotFound) if the library or a function is missing, or if it is too old.
#pragma once

#include <array>
#include <csignal>
#include <string>

#include "server/device/forcedimension/fd_api.h"

namespace palpate {

// Keeps the program's handlers of SIGINT, SIGTERM and SIGPIPE: the library has code to set some.
// Around what opens a device or moves it.
class KeptSignals {
 public:
  KeptSignals() noexcept;
  ~KeptSignals();
  KeptSignals(const KeptSignals&) = delete;
  KeptSignals& operator=(const KeptSignals&) = delete;

 private:
  static constexpr std::array<int, 3> kSignals = {SIGINT, SIGTERM, SIGPIPE};
  std::array<struct sigaction, 3> kept_{};
};

class FdLibrary {
 public:
  static constexpr const char* kDefaultPath = "libdrd.so.3";

  // path: a file, or a name for which the loader searches.
  explicit FdLibrary(const std::string& path);

  const fd::Functions& functions() const { return functions_; }
  const std::string& version() const { return version_; }  // "3.17.5"
  // "error 20, the device is in use": the last of this thread.
  std::string LastError() const;

 private:
  void CheckVersion(const std::string& path);

  fd::Functions functions_;
  std::string version_;
};

}  // namespace palpate
