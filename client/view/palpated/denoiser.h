// Filters of the whole volume, one at a time. A filter may take minutes.
//
// Threads: that of the frames; the call has a thread of its own (Commands). Errors: in problem().
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>

#include "client/sdk/edit.h"
#include "client/view/palpated/commands.h"

namespace palpate::view {

class Denoiser {
 public:
  // `client` must outlive it. The destructor waits for the filter: see Commands.
  explicit Denoiser(client::Client& client) : commands_(client) {}

  // Does nothing if a filter runs. `done`: called on the thread of the call.
  void Start(const client::Filter& filter,
             const std::function<void(const client::EditResult&)>& done) {
    if (commands_.busy()) return;
    fraction_ = 0.0;
    is_cancelled_ = false;
    commands_.Do("filter", [this, filter, done](client::Client& client) {
      done(client.RunFilter(filter, [this](const client::Progress& progress) {
        fraction_ = progress.fraction;
        return !is_cancelled_;
      }));
    });
  }
  void Cancel() { is_cancelled_ = true; }
  // The finished fraction, 0 to 1; none: no filter runs.
  std::optional<double> fraction() const {
    return commands_.busy() ? std::optional<double>(fraction_) : std::nullopt;
  }
  std::string problem() const { return commands_.problem(); }

 private:
  std::atomic<double> fraction_{0.0};
  std::atomic<bool> is_cancelled_{false};
  Commands commands_;  // last: its thread uses the others
};

}  // namespace palpate::view
