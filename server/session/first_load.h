// What clients are told until the first volume is felt.
//
// Threads: any. Errors: those that Require throws.
#pragma once

#include <mutex>
#include <string>

#include "common/error/error.h"

namespace palpate {

class FirstLoad {
 public:
  // `line`: for people, "loading head.nrrd, 40 %".
  void Tell(const std::string& line);
  void Done();
  // The daemon ends with this error.
  void Fail(const Error& error);

  bool is_done() const;
  // Returns once the first volume is felt. Throws kLoading with the last line, or Fail's error.
  void Require() const;
  // True if a client asked while the volume loaded. Such a client asks again within a moment.
  bool was_asked() const;

 private:
  mutable std::mutex mutex_;
  Error error_{ErrorKind::kLoading, "starting"};
  bool is_done_ = false;
  mutable bool was_asked_ = false;
};

}  // namespace palpate
