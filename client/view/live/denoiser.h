// Filters of the whole volume, one at a time. A filter may take minutes.
//
// Threads: that of the frames; the call has a thread of its own (Commands). Errors: in problem().
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "client/sdk/edit.h"
#include "client/view/live/commands.h"

namespace palpate::view {

class Denoiser {
 public:
  // `commands`: used for nothing else, because commands wait for the filter. It must outlive the
  // denoiser.
  explicit Denoiser(Commands& commands);

  // Does nothing if a filter runs. `done`: called on the thread of the call.
  void Start(const client::Filter& filter,
             const std::function<void(const client::EditResult&)>& done);
  void Cancel();
  // The finished fraction, 0 to 1; none: no filter runs.
  std::optional<double> fraction() const;
  std::string problem() const { return commands_.problem(); }

 private:
  struct Progress;

  Commands& commands_;
  std::shared_ptr<Progress> progress_;
};

}  // namespace palpate::view
