#include "server/session/first_load.h"

namespace palpate {

void FirstLoad::Tell(const std::string& line) {
  const std::lock_guard lock(mutex_);
  error_ = {ErrorKind::kLoading, line};
}

void FirstLoad::Done() {
  const std::lock_guard lock(mutex_);
  is_done_ = true;
}

void FirstLoad::Fail(const Error& error) {
  const std::lock_guard lock(mutex_);
  error_ = error;
}

bool FirstLoad::is_done() const {
  const std::lock_guard lock(mutex_);
  return is_done_;
}

void FirstLoad::Require() const {
  const std::lock_guard lock(mutex_);
  if (is_done_) return;
  was_asked_ = true;
  throw Error(error_);
}

bool FirstLoad::was_asked() const {
  const std::lock_guard lock(mutex_);
  return was_asked_;
}

}  // namespace palpate
