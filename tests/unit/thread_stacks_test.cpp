#include "server/app/thread_stacks.h"

#include <gtest/gtest.h>
#include <pthread.h>

#include <thread>

namespace palpate {
namespace {

TEST(ThreadStacks, AreSmallFromThenOn) {
  const auto stack_bytes = [] {
    pthread_attr_t attributes;
    std::size_t bytes = 0;
    pthread_getattr_np(pthread_self(), &attributes);
    pthread_attr_getstacksize(&attributes, &bytes);
    pthread_attr_destroy(&attributes);
    return bytes;
  };
  const SmallThreadStacks stacks;
  std::size_t bytes = 0;
  std::thread([&] { bytes = stack_bytes(); }).join();
  EXPECT_EQ(bytes, kThreadStackBytes);
  EXPECT_EQ(tbb::global_control::active_value(tbb::global_control::thread_stack_size),
            kThreadStackBytes);
}

}  // namespace
}  // namespace palpate
