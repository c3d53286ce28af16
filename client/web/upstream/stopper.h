// Emergency stops of guests, on a thread of their own: nothing else of the gateway delays them.
//
// Those who ask while a stop is under way are answered by the next one, together.
// Threads: the network thread; `stop` runs on the stopper's own. Errors: none.
#pragma once

#include <exception>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "client/web/upstream/source.h"
#include "client/web/upstream/worker.h"

namespace palpate::web {

class Stopper {
 public:
  using Done = std::function<void(const std::string& error)>;

  // Returns why the stop failed, for guests; "" if it acted.
  using Stop = std::function<std::string(const std::string& user)>;

  // It lives until no posted function runs any more.
  Stopper(Post post, Stop stop, WorkFailed failed)
      : post_(std::move(post)), stop_(std::move(stop)), worker_(std::move(failed)) {}

  // `done` is called once on the network thread, after a stop that began later than this call, in
  // the name of the first who asked for it.
  void Ask(const std::string& user, Done done) {
    waiting_.emplace_back(user, std::move(done));
    if (!std::exchange(is_under_way_, true)) Begin();
  }

 private:
  void Begin() {
    worker_.Put("stop", [this, asked = std::exchange(waiting_, {})](bool) {
      std::string error = "the stop failed";
      try {
        error = stop_(asked.front().first);
      } catch (const std::exception& problem) {
        error = problem.what();
      }
      post_([this, asked, error] {
        for (const auto& [user, done] : asked) done(error);
        is_under_way_ = !waiting_.empty();
        if (is_under_way_) Begin();
      });
    });
  }

  const Post post_;
  const Stop stop_;
  std::vector<std::pair<std::string, Done>> waiting_;
  bool is_under_way_ = false;
  Worker worker_;  // ends first
};

}  // namespace palpate::web
