#include "server/app/thread_stacks.h"

#include <pthread.h>

namespace palpate {

SmallThreadStacks::SmallThreadStacks()
    : workers_(tbb::global_control::thread_stack_size, kThreadStackBytes) {
  pthread_attr_t attributes;
  if (pthread_getattr_default_np(&attributes) != 0) return;
  pthread_attr_setstacksize(&attributes, kThreadStackBytes);
  pthread_setattr_default_np(&attributes);
  pthread_attr_destroy(&attributes);
}

}  // namespace palpate
