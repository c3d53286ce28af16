#include "server/rpc/standby_poller.h"

#include <pthread.h>

namespace palpate {

StandbyPoller::~StandbyPoller() {
  queue_->Shutdown();
  if (thread_.joinable()) {
    thread_.join();
  } else {
    Drain();
  }
}

void StandbyPoller::Start() {
  thread_ = std::thread([this] {
    pthread_setname_np(pthread_self(), "palpate-rpc");
    Drain();
  });
}

void StandbyPoller::Drain() {
  void* tag = nullptr;
  for (bool ok = false; queue_->Next(&tag, &ok);) {
  }
}

}  // namespace palpate
