#include "client/view/palpated/history.h"

#include <utility>

namespace palpate::view {

void History::Add(Step step) {
  undone_.clear();
  done_.push_back(std::move(step));
  if (done_.size() > kMost) done_.erase(done_.begin());
}

void History::Trim(Steps& steps) {
  while (!steps.empty() && steps.back().lasts && !steps.back().lasts()) steps.pop_back();
}

std::string History::NameOfLast(Steps& steps) {
  Trim(steps);
  return steps.empty() ? std::string() : steps.back().name;
}

bool History::Move(Steps& from, Steps& to, bool forward) {
  Trim(from);
  if (from.empty()) return false;
  to.push_back(std::move(from.back()));
  from.pop_back();
  // A copy: the step may change the history.
  const auto go = to.back().go;
  go(forward);
  return true;
}

void History::Forget() {
  done_.clear();
  undone_.clear();
}

}  // namespace palpate::view
