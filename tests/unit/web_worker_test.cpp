// Work that waits: the newest of a key, in order, each called once.
#include "client/web/upstream/worker.h"

#include <gtest/gtest.h>

#include <future>
#include <new>
#include <string>
#include <vector>

namespace palpate::web {
namespace {

TEST(Worker, TheNewestWorkOfAKeyReplacesWorkThatWaits) {
  std::vector<std::string> done, replaced;
  std::promise<void> begun, go, end;
  {
    Worker worker;
    worker.Put("a", [&](bool) {
      begun.set_value();
      go.get_future().wait();
      done.push_back("a1");
    });
    begun.get_future().wait();
    // The work of "a" runs, and does not wait any more.
    for (const char* const name : {"a2", "b1", "a3", "a4", "b2"}) {
      worker.Put(std::string(1, name[0]), [&, name](bool is_replaced) {
        (is_replaced ? replaced : done).emplace_back(name);
      });
    }
    EXPECT_EQ(replaced, (std::vector<std::string>{"a2", "a3", "b1"}));
    worker.Put("c", [&](bool) { end.set_value(); });
    go.set_value();
    end.get_future().wait();
  }
  EXPECT_EQ(done, (std::vector<std::string>{"a1", "a4", "b2"}));
}

TEST(Worker, WorkThatThrowsEndsNothingElse) {
  std::promise<std::string> why, after;
  Worker worker([&](const std::string& told) { why.set_value(told); });
  worker.Put("a", [](bool) { throw std::bad_alloc(); });
  worker.Put("b", [&](bool) { after.set_value("done"); });
  EXPECT_EQ(why.get_future().get(), std::bad_alloc().what());
  EXPECT_EQ(after.get_future().get(), "done");
}

TEST(Worker, WorkThatGoesLastIsDoneInOrder) {
  std::vector<std::string> done;
  std::promise<void> begun, go, end;
  {
    Worker worker;
    worker.Put("first", [&](bool) {
      begun.set_value();
      go.get_future().wait();
    });
    begun.get_future().wait();
    for (const char* const name : {"a1", "b1", "a2"}) {
      worker.PutLast(std::string(1, name[0]), [&, name](bool is_replaced) {
        if (!is_replaced) done.emplace_back(name);
      });
    }
    worker.Put("end", [&](bool) { end.set_value(); });
    go.set_value();
    end.get_future().wait();
  }
  EXPECT_EQ(done, (std::vector<std::string>{"b1", "a2"}));
}

}  // namespace
}  // namespace palpate::web
