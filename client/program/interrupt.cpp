#include "client/program/interrupt.h"

#include <atomic>
#include <csignal>

namespace palpate {
namespace {

std::atomic<bool> raised{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler must not wait");

void Raise(int) { raised.store(true); }

}  // namespace

Interrupt::Interrupt() {
  raised.store(false);
  struct sigaction action {};
  action.sa_handler = Raise;
  // Without SA_RESTART, so that a blocked write returns.
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGHUP, &action, nullptr);
}

Interrupt::~Interrupt() {
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  std::signal(SIGHUP, SIG_DFL);
}

bool Interrupt::IsRaised() { return raised.load(); }

}  // namespace palpate
